"""Readers of other people's formats, chosen by content, and what is checked before anything is learned."""

from skillctl.demonstrations.formats import FORMATS
from skillctl.demonstrations.reader import InputFile, ReadResult, read_demonstrations
from skillctl.demonstrations.writing import write_csv

__all__ = ["FORMATS", "InputFile", "ReadResult", "read_demonstrations", "write_csv"]
