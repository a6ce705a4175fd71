"""Validated plain data: sections of keys, the kinds of values that keys take, and the wording of errors."""
