"""Readers of other people's formats, chosen by content, and what is checked before anything is learned."""
