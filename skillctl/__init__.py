"""Robot skills: learn them from demonstrations, make new ones from learned ones, prove them stable."""

__version__ = "0.1.0"
