"""The configuration: YAML to plain validated data, in milliseconds and without any numerics.

`load` reads a file into a `Config` or raises one `ConfigError` that lists all errors, each with its place,
its key and the values allowed. `digest` is a hash of everything that determines a case's results.
"""

from gfmdlayer.config.model import Config, digest
from gfmdlayer.config.reader import load
from gfmdlayer.validation.problems import ConfigError

__all__ = ["Config", "ConfigError", "digest", "load"]
