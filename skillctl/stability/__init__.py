"""What is proved of a skill, in exact arithmetic; and what sampling shows where nothing is proved."""
