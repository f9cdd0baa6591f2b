"""A skill on an arm, in PyBullet: one episode, its figures, its log and its picture.

Importing this room needs neither PyBullet nor Pillow; both are loaded when they are used.
"""
