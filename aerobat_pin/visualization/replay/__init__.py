"""A motion to look at in a browser: scene, page, pictures."""
