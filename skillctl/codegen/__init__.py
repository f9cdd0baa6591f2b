"""A skill as C99: one header that commands what the controller commands, without Python."""
