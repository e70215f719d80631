"""Replay a motion in a browser: build the scene, the HTML page, and pictures of it."""
