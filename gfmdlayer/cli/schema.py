"""`gfmdlayer schema`: print the JSON Schema of a configuration, for editors."""

from __future__ import annotations

import argparse
import json

from gfmdlayer.cli.terminal import COMPLETE, Verbs


def register(verbs: Verbs) -> None:
    """Add the verb to the command line."""
    verbs.add(
        schema,
        "print the JSON Schema of a configuration, for editors",
        "gfmdlayer schema > gfmdlayer.schema.json",
    )


def schema(options: argparse.Namespace) -> int:  # noqa: ARG001
    """Print the JSON Schema of a configuration."""
    from gfmdlayer.config.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return COMPLETE
