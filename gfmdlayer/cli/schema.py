"""`gfmdlayer schema`: print the JSON Schema of a configuration, for editors."""

from __future__ import annotations

import argparse
import json

from gfmdlayer.cli.terminal import COMPLETE

EXAMPLE = "gfmdlayer schema > gfmdlayer.schema.json"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""


def schema(options: argparse.Namespace) -> int:  # noqa: ARG001
    """Print the JSON Schema of a configuration."""
    from gfmdlayer.config.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return COMPLETE
