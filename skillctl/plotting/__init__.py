"""Figures of skills. Matplotlib is imported in this room only, and only once something is drawn."""

import logging

# Without a writable home Matplotlib warns about its cache, which is no news to who wants a picture.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
