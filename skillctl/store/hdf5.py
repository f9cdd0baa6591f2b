"""h5py, imported with plugins switched off."""

from __future__ import annotations

import os

# Set before HDF5 starts: "::" turns off the loading of filter plugins, which is code that a file can request
# by number, from the directory in HDF5_PLUGIN_PATH.
os.environ["HDF5_PLUGIN_PRELOAD"] = "::"

import h5py

__all__ = ["h5py"]
