"""Fits of thousands of force curves, one by one, over processes and ranks; maps of the parameters."""
