"""Figures of skills. Matplotlib is imported in this room only, and only once something is drawn."""

import logging

# Without a writable home Matplotlib warns about its cache, which does not concern the user.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
