"""`paddlectl export`."""

from pathlib import Path
from typing import Annotated

import typer

from paddlectl.cli.options import RegistryPlace, complete_runs, file_at
from paddlectl.errors import UsageError

EXAMPLE = "Example: paddlectl export run-42 --parquet --to data"


def export(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN", autocompletion=complete_runs, help="Its id or name; or latest.", show_default=False
        ),
    ],
    as_csv: Annotated[
        bool, typer.Option("--csv", help="A file for each table; so without any of these.")
    ] = False,
    as_parquet: Annotated[bool, typer.Option("--parquet", help="The same as Parquet.")] = False,
    as_tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="The numbers as TensorBoard's events.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the run and its tables as one JSON document.")
    ] = False,
    to: Annotated[
        Path, typer.Option(parser=file_at, metavar="FOLDER", help="Where a folder of the run is made.")
    ] = Path("data"),
    registry: RegistryPlace = "registry",
) -> None:
    """Write a run's tables as CSV, Parquet, TensorBoard's events or JSON."""
    from paddlectl.registry.files.objects import write_atomically
    from paddlectl.registry.store import Registry
    from paddlectl.report.documents import run_row
    from paddlectl.report.exported import files_of, tables_of
    from paddlectl.report.output import clean, print_json, print_text

    asked = {"csv": as_csv, "parquet": as_parquet, "tensorboard": as_tensorboard}
    kinds = [kind for kind in asked if asked[kind]] or ([] if as_json else ["csv"])
    with Registry.open(registry, create=False) as opened:
        record = opened.run(run)
        tables = tables_of(opened, record.id)
    folder = to / record.id
    for place in (to, folder):
        if place.exists() and not place.is_dir():
            raise UsageError(f"{place} is not a folder", "name another: --to FOLDER")
    made = {folder / name: data for kind in kinds for name, data in files_of(kind, record, tables).items()}
    if made:
        folder.mkdir(parents=True, exist_ok=True)
    for path, data in made.items():
        write_atomically(path, data, shared=False)
    if as_json:
        print_json({"run": run_row(record), "tables": tables, "files": [str(path) for path in made]})
    else:
        print_text([clean(path) for path in made] or [f"{record.id} has no tables"])
