"""Readers of demonstration formats, chosen by content, and the checks before learning."""
