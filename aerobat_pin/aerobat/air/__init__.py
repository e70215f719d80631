"""The air of the flapping robot: strips on its links, added mass, and the air along a recorded motion."""
