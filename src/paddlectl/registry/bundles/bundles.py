"""A policy or a run as one file, and back: a zipped model folder that holds all that the registry knows.

Nothing in it depends on the registry that it came from, so it is the same byte for byte when it is exported
again elsewhere. README.md, program.pl and replay.gif are for people and other programs; they are written,
never read.
"""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import safetensors

from paddlectl.errors import IntegrityError, InvalidFileError, PaddlectlError, UsageError
from paddlectl.logic.prolog import format_prolog
from paddlectl.logic.syntax import parse_program
from paddlectl.registry import fields
from paddlectl.registry.bundles import archive
from paddlectl.registry.bundles.adoption import adopt
from paddlectl.registry.bundles.card import card
from paddlectl.registry.files import documents, layout, manifests
from paddlectl.registry.files.objects import write_atomically
from paddlectl.registry.files.runfiles import bytes_of, while_it_stays
from paddlectl.registry.names import ELSEWHERE, is_id, number_of
from paddlectl.registry.records import PolicyRecord, RunRecord
from paddlectl.registry.store import Registry

FORMAT = "paddlectl bundle 1"
REPLAY = "replay.gif"
LONGEST_REPLAY = 300_000
"""Bytes."""
_LONGEST_DOCUMENT = 1 << 20
_GIF = b"GIF89a"


# Export


def export(
    registry: Registry, name: str, path: Path, replay: Callable[[PolicyRecord], bytes] = lambda _: b""
) -> dict[str, Any]:
    """Writes a run with its tables, or a policy with what it came from, to a new file.

    Args:
        registry: Where it is.
        name: A run's or a policy's id, or a task's name for its best policy.
        path: The file.
        replay: Gives an episode of a policy as a GIF; nothing if there can't be one.

    Raises:
        NotFoundError: If there is no such run or policy.
        UsageError: If the file is there already, or the run goes on.
        IntegrityError: If something of it isn't what was stored.
    """
    if path.exists() or path.is_symlink():
        raise UsageError(f"{path} is there already", "give a new file")
    data = packed(registry, name, replay)
    write_atomically(path, data, shared=False)
    return {"exported": name, "file": str(path), "bytes": len(data)}


def packed(registry: Registry, name: str, replay: Callable[[PolicyRecord], bytes] = lambda _: b"") -> bytes:
    """The bytes of such a file.

    Raises:
        PaddlectlError: As `export` does.
    """
    run, policy, tables = _whole(registry, name)
    checkpoint = registry.read_checkpoint(policy) if policy else b""
    members = _members(run, policy, checkpoint, replay(policy) if policy else b"", tables)
    _sound(members, f"{name} can't be exported", "run: paddlectl registry check")  # as import would say
    data = archive.pack(members)
    if len(data) > archive.LARGEST:
        raise PaddlectlError(f"{name} is too large for a bundle: {len(data):,} bytes")
    return data


def _whole(registry: Registry, name: str) -> tuple[RunRecord, PolicyRecord | None, dict[str, bytes]]:
    """A run, its policy, and the run's tables if it is the run that is named; all of one moment."""
    while True:
        if is_id(name) and name.startswith("run-"):
            run = registry.run(name)
            policy = registry.policy(run.policy) if run.policy else None
        else:
            policy = registry.policy(name)
            run = registry.run(policy.run)
        if run.status == "running":
            raise _goes_on(run)
        tables = _tables(registry, run) if run.id == name else {}
        if registry.run(run.id) == run:  # else it was resumed meanwhile
            return run, policy, tables


def _tables(registry: Registry, run: RunRecord) -> dict[str, bytes]:
    def read(seals: Mapping[str, manifests.Seal] | None) -> dict[str, bytes]:
        if seals is None:
            raise _goes_on(run)
        paths = {*layout.run_files(registry.folder, run.id), *(registry.folder / file for file in seals)}
        found = {path: bytes_of(path) for path in paths}
        for path, data in found.items():
            manifests.verify(registry.folder, path, data, seals)
        return {path.name: data for path, data in found.items() if data is not None}

    return while_it_stays(registry.folder, run.id, read)


def _goes_on(run: RunRecord) -> UsageError:
    return UsageError(f"{run.id} goes on", "export it when it has ended")


def _members(
    run: RunRecord, policy: PolicyRecord | None, checkpoint: bytes, replay: bytes, tables: dict[str, bytes]
) -> dict[str, bytes]:
    told = {name: getattr(run, name) for name in fields.RUN}
    told["sources"] = [source.removeprefix(ELSEWHERE) for source in run.sources]
    config = {
        "format": FORMAT,
        "run": told,
        "policy": policy and {name: getattr(policy, name) for name in fields.POLICY},
    }
    results = {
        "run": run.results,
        "policy": policy and {name: getattr(policy, name) for name in fields.FIGURES},
    }
    members = {"config.json": _json(config), "results.json": _json(results)}
    if policy:
        if policy.program is not None:
            members["program.txt"] = policy.program.encode()
            members["program.pl"] = format_prolog(_program(policy.program, policy.id)).encode()
        members["model.safetensors"] = checkpoint
    if replay:
        members[REPLAY] = replay
    members |= {f"run/{name}": tables[name] for name in sorted(tables)}
    readme = card(config, results, ["README.md", *members, "manifest.json"]).encode()
    members = {"README.md": readme, **members}
    return members | {"manifest.json": _json(_seals(members))}


def _json(value: Any) -> bytes:
    return documents.to_json(value, "the bundle").encode() + b"\n"


def _seals(members: dict[str, bytes]) -> dict[str, Any]:
    return {name: list(manifests.seal_of(data)) for name, data in members.items()}


def _program(text: str, where: str) -> Any:
    try:
        return parse_program(text)
    except InvalidFileError as error:
        raise IntegrityError(f"the program of {where} is damaged: {error.message}") from error


# Import


def import_(opened: Callable[[], Registry], path: Path) -> dict[str, Any]:
    """Takes in what `export` wrote: wholly, or not at all.

    Args:
        opened: Opens the registry, which isn't made for a file that is refused.
        path: The file.

    Returns:
        `{run, policy, known}`: their ids here, and whether they were here already.

    Raises:
        NotFoundError: If there is no such file.
        IntegrityError: If it is anything else than what `export` wrote.
    """
    run, tables, policy, checkpoint = _content(archive.load(path), str(path))
    run["sources"] = [f"{ELSEWHERE}{source}" for source in run["sources"]]
    with opened() as registry:
        return adopt(registry.index, run, tables, policy, checkpoint)


def take_back(registry: Registry, data: bytes) -> dict[str, Any]:
    """Takes in a run that was learned elsewhere for this registry: its sources are policies of it.

    Returns:
        As `import_` does.

    Raises:
        NotFoundError: If a source isn't there.
        IntegrityError: If the bytes are anything else than what `packed` gave.
    """
    run, tables, policy, checkpoint = _content(data, "what was learned elsewhere")
    for source in run["sources"]:
        registry.policy(source)
    return adopt(registry.index, run, tables, policy, checkpoint)


def lend(registry: Registry, data: bytes, policy: str) -> None:
    """Takes in a policy under the id that it has elsewhere, in a registry where that is free.

    Raises:
        IntegrityError: If the bytes are anything else than what `packed` gave.
    """
    run, tables, learned, checkpoint = _content(data, policy)
    run["sources"] = [f"{ELSEWHERE}{source}" for source in run["sources"]]
    assert learned is not None
    adopt(registry.index, run, tables, learned | {"id": number_of(policy, "policy")}, checkpoint)


def _content(data: bytes, where: str) -> tuple[Any, dict[str, bytes], Any, bytes]:
    """The values of a run, its tables, the values of its policy and that one's checkpoint."""
    members = archive.unpack(data, where)
    config, results, tables = _sound(members, f"{where} is no sound bundle", "have it exported again")
    run = config["run"] | {"results": results["run"]}
    policy = config["policy"]
    if policy is not None:
        program = members["program.txt"].decode() if "program.txt" in members else None
        policy |= results["policy"] | {"program": program}
    return run, tables, policy, members.get("model.safetensors", b"")


def _sound(members: dict[str, bytes], otherwise: str, hint: str) -> tuple[Any, Any, dict[str, bytes]]:
    """Config, results and tables of a bundle.

    Raises:
        IntegrityError: If it isn't in order.
    """
    try:
        return _checked(members)
    except (KeyError, TypeError, AttributeError, UnicodeDecodeError, PaddlectlError) as error:
        what = f"{type(error).__name__} {error}"
        if isinstance(error, PaddlectlError):
            what, hint = error.message, error.hint or hint
        raise IntegrityError(f"{otherwise}: {what[:200]}", hint) from None


def _checked(members: dict[str, bytes]) -> tuple[Any, Any, dict[str, bytes]]:
    seals = _document(members["manifest.json"], "manifest.json")
    members = {name: data for name, data in members.items() if name != "manifest.json"}
    if seals != _seals(members):
        raise IntegrityError("a file isn't what its manifest says (SHA-256 differs)")
    config = _document(members["config.json"], "config.json")
    results = _document(members["results.json"], "results.json")
    if config["format"] != FORMAT:
        hint = "import it with the version of paddlectl that exported it"
        raise IntegrityError(f"its format isn't {FORMAT!r}, which this version reads", hint)
    if config.keys() != {"format", "run", "policy"}:
        raise IntegrityError("it hasn't the fields of one")
    policy = config["policy"]
    tables = {name[4:]: data for name, data in members.items() if name.startswith("run/")}
    expected = ["README.md", "config.json", "results.json"]
    if policy is not None:
        expected += ["program.txt", "program.pl"] if "program.txt" in members else []
        expected += ["model.safetensors", *([REPLAY] if REPLAY in members else [])]
    if list(members) != expected + [f"run/{name}" for name in sorted(tables)]:
        raise IntegrityError("it has other files than a bundle has")
    _demand(config["run"], fields.RUN, "run")
    _demand(results, {"run": dict, "policy": dict}, "results", optional={"policy"})
    if odd := fields.odd_figure(results["run"]):
        raise IntegrityError(f"results: {odd}")
    if policy is not None:
        _demand(policy, fields.POLICY, "policy")
        _demand(results["policy"], fields.FIGURES, "results")
        if "program.txt" in members:
            _program(members["program.txt"].decode(), "it")
        _demand_tensors(members["model.safetensors"])
        _demand_gif(members.get(REPLAY, _GIF))
    for name, data in tables.items():
        _demand_table(name, data)
    return config, results, tables


def _document(data: bytes, name: str) -> Any:
    if len(data) > _LONGEST_DOCUMENT:
        raise IntegrityError(f"{name} is too long")
    value = documents.document_of(data, Path(name))
    if not isinstance(value, dict) or _json(value) != data:
        raise IntegrityError(f"{name} isn't as export writes it")
    return value


def _demand(
    value: Any, kinds: Mapping[str, Any], what: str, optional: Collection[str] = fields.OPTIONAL
) -> None:
    if not isinstance(value, dict) or value.keys() != kinds.keys():
        raise IntegrityError(f"{what} has other fields than it should")
    if wrong := fields.misfit(value, kinds, optional):
        raise IntegrityError(f"{what}: {wrong}")


def _demand_tensors(data: bytes) -> None:
    try:
        safetensors.deserialize(data)  # type: ignore[no-untyped-call]
    except safetensors.SafetensorError as error:
        raise IntegrityError(f"model.safetensors is none: {str(error)[:100]!r}") from None


def _demand_gif(data: bytes) -> None:
    if not data.startswith(_GIF) or len(data) > LONGEST_REPLAY:
        raise IntegrityError(f"{REPLAY} is none")


def _demand_table(name: str, data: bytes) -> None:
    path = Path(name)
    if path.suffix == ".jsonl" and (not data or data.endswith(b"\n")):
        documents.rows_of(data, path)
    elif path.suffix == ".json":
        documents.document_of(data, path)
    else:
        raise IntegrityError(f"{name[:80]!r} is no table")
