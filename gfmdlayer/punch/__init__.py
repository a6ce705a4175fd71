"""The rigid punch: the heights of its surface, and its trajectory."""
