"""What released versions left: `registry/released/<schema>`, with the database as SQL, and exported bundles.

`freeze.py` makes those of this version.
"""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

RELEASED = Path(__file__).parent / "registry" / "released"
BUNDLES = Path(__file__).parent / "registry" / "bundles"
SCHEMAS = sorted(path.name for path in RELEASED.iterdir())


def rebuilt(schema: str, location: Path) -> Path:
    """Makes a registry of that schema as its version left it."""
    shutil.copytree(RELEASED / schema, location, ignore=shutil.ignore_patterns(".keep", "*.sql"))
    with closing(sqlite3.connect(location / "registry.db")) as connection:
        connection.executescript((RELEASED / schema / "registry.sql").read_text())
    return location
