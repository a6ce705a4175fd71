"""Newton's method for interfaces that attract, along the path that the surface takes."""
