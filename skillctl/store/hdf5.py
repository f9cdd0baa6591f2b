"""h5py, imported with plugins switched off."""

from __future__ import annotations

import os

# Before HDF5 starts: "::" turns off the loading of filter plugins, code that a file can ask for by number
# and that would be taken from wherever HDF5_PLUGIN_PATH points.
os.environ["HDF5_PLUGIN_PRELOAD"] = "::"

import h5py

__all__ = ["h5py"]
