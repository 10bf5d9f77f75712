# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measures a scene with its keys varied, thousands of times, shared among workers.

Each row depends on its scene alone: results are the same to the bit with any number of workers, of
this machine or of a cluster, and when a study was interrupted.

A study's rows are written to disk at once, and an interrupted study resumes from them.

``study.json`` defines the study, ``rows.txt`` has a line for each scene, in the order of their
arrival: the CRC-32 of the rest, in hexadecimal digits, and JSON: the scene's number, and its
numbers, or why it failed. An incomplete line is cut off when the study resumes, and its scene is
measured again; none is ever written twice.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from hapticmech_ros.analysis.study import Results, Sheet, plain
from hapticmech_ros.errors import HapticMechError, InvalidInputError, SceneError
from hapticmech_ros.files import open_file
from hapticmech_ros.loading.loader import find_scene, scene_as_written, with_links
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene, document_of
from hapticmech_ros.scene.validation import UNKNOWN_KEY, with_changes, written_document
from hapticmech_ros.study.design import Design, number_of
from hapticmech_ros.study.figure import study_figure
from hapticmech_ros.study.task import Task, carry_out, with_unit
from hapticmech_ros.system.installation import PACKAGE
from hapticmech_ros.system.workers import Lost, WorkerPool, Workers, versions

DEFINITION, ROWS = "study.json", "rows.txt"
# Largest size of ``study.json``, bytes; a larger file is none.
MOST_BYTES = 64_000_000


class StudyError(HapticMechError):
    """A study cannot resume: its folder has another one, or is in use."""


# Rows by the number of their scene: its numbers (m,), or why it has none, in words.
Rows = dict[int, Array | str]


class Journal(AbstractContextManager["Journal"]):
    """Writes rows, and knows those that are there; a context, in which no other process writes.

    Args:
        folder: of the study, created if needed.
        definition: of the study, as in JSON.
        columns: names of the numbers of each row.

    Attributes:
        rows: those that were there when it was opened.

    Raises:
        StudyError: the folder has another study, or another process is at it.
    """

    def __init__(self, folder: Path, definition: Mapping[str, Any], columns: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = (folder / ROWS).open("a+b")
        try:
            self._begin({**definition, "columns": list(columns)})
            self.rows = self._read()
        except BaseException:
            self._file.close()
            raise

    def __exit__(self, *_: object) -> None:
        os.fsync(self._file.fileno())
        self._file.close()

    def write(self, rows: Rows) -> None:
        """Add rows of scenes that have none; when this process ends they are not lost."""
        for index, row in rows.items():
            found = {"why": row} if isinstance(row, str) else {"numbers": row.tolist()}
            text = (json.dumps({"index": index, **found}, ensure_ascii=False) + "\n").encode()
            self._file.write(b"%08x %b" % (zlib.crc32(text), text))
        self._file.flush()

    def _begin(self, definition: dict[str, Any]) -> None:
        """Write the study's definition, or check that the folder's is the same.

        Raises:
            StudyError: it is another one, or another process uses it.
        """
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(f"{self._folder}: another process is at this study") from None
        path = self._folder / DEFINITION
        text = json.dumps(definition, indent=1, ensure_ascii=False)
        if not path.exists():
            if os.fstat(self._file.fileno()).st_size:
                raise StudyError(f"{self._folder} has rows of a study, but no {DEFINITION}")
            # Whole or not at all: a study begins with a definition.
            new = path.with_name(f".{path.name}")
            new.write_text(text + "\n", encoding="utf-8")
            new.replace(path)
            return
        there = _definition(path)
        wanted = json.loads(text)
        others = [key for key in {**wanted, **there} if wanted.get(key) != there.get(key)]
        if others:
            raise StudyError(
                f"{self._folder} has another study, which differs in {', '.join(others)}: choose"
                " another folder, or remove this one"
            )

    def _read(self) -> Rows:
        """Return the stored rows, and cut off an incomplete one."""
        rows, size = Rows(), 0
        self._file.seek(0)
        for line in self._file:
            crc, _, text = line.partition(b" ")
            if crc != b"%08x" % zlib.crc32(text):
                break
            found = json.loads(text)
            row = found["why"] if "why" in found else np.array(found["numbers"])
            rows[found["index"]] = row
            size += len(line)
        self._file.truncate(size)
        return rows


def _definition(path: Path) -> dict[str, Any]:
    found = None
    if path.stat().st_size <= MOST_BYTES:
        with suppress(ValueError):
            found = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(found, dict):
        raise StudyError(f"{path} is no definition of a study")
    return found


# Scenes of one task.
CHUNK = 64
# Bytes of a file that are hashed at a time.
BLOCK = 1 << 20
TABLE = "study.npz"
# Largest number of printed reasons for failures.
REASONS_SHOWN = 5

Show = Callable[[int, int], None]


@dataclass(frozen=True)
class ParameterStudy(Results):
    """A study that came to its end.

    Attributes:
        scene: its name.
        scene_sha256: of the scene before keys were varied, and of the files that it names.
        design: of the scenes.
        columns: names of the m numbers.
        index: (n,) numbers of the scenes that were measured, ascending.
        numbers: (n, m) their measures, in SI units.
        failed: why others were not measured, by number.
        lost: numbers of scenes whose worker was ended, twice; they are tried again next time.
    """

    NAME: ClassVar[str] = "summary"
    FAULT: ClassVar[str] = "scenes were lost with their workers; the same command tries them again"

    scene: str
    scene_sha256: str
    design: Design
    columns: tuple[str, ...]
    index: npt.NDArray[np.int64]
    numbers: Array
    failed: Mapping[int, str]
    lost: tuple[int, ...]

    @property
    def sound(self) -> bool:
        """Whether no scene was lost."""
        return not self.lost

    def values(self) -> dict[str, npt.NDArray[Any]]:
        """Return the value of each variation in each scene that was measured, (n,) by its keys.

        Angles written as text are in rad; values that are no numbers are texts.
        """
        rows = [self.design.values(number) for number in self.index.tolist()]
        found = {}
        for at, one in enumerate(self.design.variations):
            texts = [row[at] for row in rows]
            numbers = [number_of(text) for text in texts]
            known = [number for number in numbers if number is not None]
            found[one.name] = np.array(known if len(known) == len(texts) else texts)
        return found

    def arrays(self) -> dict[str, Any]:
        """Return ``index``, values by their keys and measured numbers by their names, (n,) each."""
        measured = zip(self.columns, self.numbers.T, strict=True)
        return {"index": self.index, **self.values(), **dict(measured)}

    def to_dataframe(self) -> Any:
        """Return :meth:`arrays` as a data frame, which writes itself as Parquet, for instance.

        Raises:
            ImportError: pandas is not installed.
        """
        pandas = import_module("pandas")
        return pandas.DataFrame(self.arrays()).set_index("index")

    def document(self) -> dict[str, object]:
        """Return the study's definition and its distributions; the numbers are in ``study.npz``."""
        return {
            "scene": self.scene,
            "scene_sha256": self.scene_sha256,
            "scenes": len(self.design),
            "measured": int(self.index.size),
            "failed": len(self.failed),
            "lost": list(self.lost),
            "spread": {name: _spread(column) for name, column in self._measured()},
        }

    def sheets(self) -> Iterator[Sheet]:
        """Yield how each number is spread over the scenes."""
        rows = []
        for name, column in self._measured():
            spread = _spread(column)
            shown = ("-" if one is None else f"{one:.4g}" for one in spread.values())
            rows.append((with_unit(name), *shown))
        yield Sheet(
            f"{self.scene}: {self.index.size} of {len(self.design)} scenes measured",
            ("number", "least", "median", "largest", "infinite"),
            tuple(rows),
        )

    def notes(self) -> Iterator[str]:
        """Yield why scenes failed, the most frequent reasons first."""
        reasons = list(self.failed.values())
        often = sorted(set(reasons), key=lambda why: (-reasons.count(why), why))
        for why in often[:REASONS_SHOWN]:
            yield f"{reasons.count(why)} failed: {why}"
        if len(often) > REASONS_SHOWN:
            yield f"and for {len(often) - REASONS_SHOWN} more reasons, see {ROWS}"
        if self.lost:
            yield f"{len(self.lost)} lost: {', '.join(map(str, self.lost[:REASONS_SHOWN]))}"

    def figures(self) -> Mapping[str, Figure]:
        """Return each number over each key."""
        if not self.index.size:
            return {}
        measured = dict(self._measured())
        return {"study.png": study_figure(self.scene, self.values(), measured)}

    def write(self, out: Path, figure: Path | None = None) -> None:
        """Write the table besides; see :class:`~hapticmech_ros.analysis.study.Results`."""
        super().write(out, figure)
        with (out / TABLE).open("wb") as file:
            np.savez(file, scene_sha256=np.array(self.scene_sha256), **self.arrays())

    def _measured(self) -> Iterator[tuple[str, Array]]:
        yield from zip(self.columns, self.numbers.T, strict=True)


def run_study(
    scene: str | os.PathLike[str] | Scene,
    design: Design,
    measures: Sequence[str] = ("felt",),
    point: str = "",
    changes: Sequence[str] = (),
    folder: Path | None = None,
    workers: Workers = 1,
    show: Show = lambda done, total: None,
) -> ParameterStudy:
    """Measure a scene with its keys varied.

    Args:
        scene: a path, a shipped scene's name, or a scene. It has to run unchanged: it determines
            the columns. Of a file, keys are those that are written in it, such as points of a
            ``linkage``, or of the links of its ``model``; gains follow rules anew where it gives
            none. Of a scene they are kept.
        design: how its keys vary.
        measures: names of measures; see :mod:`~hapticmech_ros.study.task`.
        point: operational point; the scene's first one if empty.
        changes: ``key=value`` each, of all scenes.
        folder: of rows, for resuming; None keeps them in memory.
        workers: that share the scenes. A script that calls this with several processes has to guard
            it by ``if __name__ == "__main__"``.
        show: called with the number of scenes done and their total.

    Returns:
        All scenes' numbers, those of an earlier call in the same folder included.

    Raises:
        InvalidInputError: an unknown measure or point, one without numbers, or no process.
        SceneError: keys that the scene has not.
        HapticMechError: the scene itself cannot be measured.
        StudyError: the folder has another study, or another process is at it.
    """
    if not measures:
        raise InvalidInputError("measures", "none", "there must be at least one")
    first = Task(*_written(scene, changes, design), tuple(measures), point)
    base = first.scene(())
    base.operational_point(point)
    columns = tuple(first.measured(base))
    _refuse_unknown_keys(first, design)
    digest = _sha256(base)
    definition = {
        "format": "hapticmech-study/1",
        "version": versions()[PACKAGE],
        "scene": base.name,
        "scene_sha256": digest,
        "variations": [plain(one) for one in design.variations],
        "samples": design.samples,
        "seed": design.seed,
        "measures": list(measures),
        "point": base.operational_point(point).name,
    }
    if folder is None:
        rows, lost = _filled(Rows(), design, first, columns, workers, show, lambda more: None)
    else:
        with Journal(folder, definition, columns) as journal:
            rows, lost = _filled(journal.rows, design, first, columns, workers, show, journal.write)
    measured = {index: row for index, row in sorted(rows.items()) if not isinstance(row, str)}
    return ParameterStudy(
        base.name,
        digest,
        design,
        columns,
        np.array(list(measured), dtype=np.int64),
        np.array(list(measured.values())).reshape(len(measured), len(columns)),
        {index: row for index, row in sorted(rows.items()) if isinstance(row, str)},
        tuple(sorted(lost)),
    )


def _written(
    scene: str | os.PathLike[str] | Scene, changes: Sequence[str], design: Design
) -> tuple[object, Path]:
    """Return the document that is varied, and its path.

    Raises:
        SceneError: not found, not readable, or keys that are none.
    """
    if isinstance(scene, Scene):
        document: object = document_of(scene)
        path = Path(scene.name)
    else:
        path = find_scene(scene).absolute()
        document = written_document(path)
    document = with_changes(document, changes, str(path))
    keys = [key.partition(".")[0] for one in design.variations for key in one.keys]
    if isinstance(document, Mapping) and "model" in document and "model" not in keys:
        # The file is read once, and its links have keys.
        document = with_links(document, path)
    return document, path


def _filled(
    rows: Rows,
    design: Design,
    first: Task,
    columns: tuple[str, ...],
    workers: Workers,
    show: Show,
    write: Callable[[Rows], None],
) -> tuple[Rows, list[int]]:
    """Measure the scenes that have no row yet, and write their rows as they come.

    Returns:
        All rows, and the numbers of scenes that were lost.
    """
    total, lost = len(design), list[int]()
    left = [index for index in range(total) if index not in rows]
    show(total - len(left), total)
    with WorkerPool(workers) as pool:
        chunks = [left[at : at + CHUNK] for at in range(0, len(left), CHUNK)]
        while chunks:
            alone = list[list[int]]()
            tasks = (first.of(chunk, design) for chunk in chunks)
            for at, found in pool.completed(carry_out, tasks):
                if not isinstance(found, Lost):
                    more = {index: _row(numbers, columns) for index, numbers in found}
                    write(more)
                    rows |= more
                    show(len(rows), total)
                elif len(chunks[at]) > 1:
                    # One of them ended the worker: the others have nothing to do with it.
                    alone += [[index] for index in chunks[at]]
                else:
                    lost += chunks[at]
            chunks = alone
    return rows, lost


def _row(numbers: Mapping[str, float] | str, columns: tuple[str, ...]) -> Array | str:
    if isinstance(numbers, str):
        return numbers
    if tuple(numbers) != columns:
        return f"has other numbers than the first scene: {', '.join(numbers)}"
    return np.array(list(numbers.values()))


def _refuse_unknown_keys(task: Task, design: Design) -> None:
    """Refuse keys that the scene has not, which would fail in each of thousands of scenes.

    Raises:
        SceneError: one is none; values may break rules.
    """
    for index in (0, len(design) - 1):
        # A path that leads nowhere is refused here.
        document = with_changes(task.document, design.changes(index), str(task.path))
        try:
            scene_as_written(document, task.path)
        except SceneError as error:
            if any(one.rule == UNKNOWN_KEY for one in error.problems):
                raise


def _sha256(scene: Scene) -> str:
    """Return the hash of a scene's document and of the files that it names."""
    document = document_of(scene)
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode())
    for path in _files(document):
        with open_file(path) as file:
            while block := file.read(BLOCK):
                digest.update(block)
    return digest.hexdigest()


def _files(value: object) -> Iterator[str]:
    """Yield the paths of files in a scene's document."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key == "file" and isinstance(inner, str):
                yield inner
            else:
                yield from _files(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _files(inner)


def _spread(column: Array) -> dict[str, float | None]:
    """Return least, median and largest of the finite numbers, and how many are infinite."""
    finite = column[np.isfinite(column)]
    infinite = float(np.isinf(column).sum())
    if not finite.size:
        return {"least": None, "median": None, "largest": None, "infinite": infinite}
    return {
        "least": float(finite.min()),
        "median": float(np.median(finite)),
        "largest": float(finite.max()),
        "infinite": infinite,
    }
