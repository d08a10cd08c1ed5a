"""Store results as numbers and names: JSON and arrays in one file, without code.

A file holds nested containers, arrays, paths, members of enumerations and dataclasses of this
project. Reading one builds such objects only; unlike a pickle it can't call anything.
"""

import dataclasses
import importlib
import io
import json
import zipfile
from collections.abc import Callable
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["OWN_PACKAGES", "dump", "load"]

OWN_PACKAGES = frozenset({"calib", "measuring", "metrology", "physics", "vision"})
"""Packages whose classes may appear in a stored result."""

MAX_STORED_BYTES = 200_000_000
"""Largest content of one file, bytes (chosen: the largest clip's tracks take a tenth)."""

_TREE = "tree.json"


def dump(value: object) -> bytes:
    """Content of a file that holds `value`.

    Parameters
    ----------
    value : object
        Made of None, bool, int, float, str, bytes, lists, tuples, sets, dicts, arrays, paths, and
        of dataclasses and enumerations of this project.

    Raises
    ------
    TypeError
        If it holds anything else, or exceeds `MAX_STORED_BYTES`.
    """
    writer = _TreeWriter()
    tree = json.dumps(writer.tree(value), separators=(",", ":")).encode()
    if len(tree) + sum(array.nbytes for array in writer.arrays) > MAX_STORED_BYTES:
        raise TypeError("the result is too large to be stored")
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as content:
        content.writestr(_TREE, tree)
        for number, array in enumerate(writer.arrays):
            with content.open(f"{number}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
    return file.getvalue()


def load(content: bytes) -> Any:
    """Value that `dump` stored.

    Raises
    ------
    ValueError, TypeError, KeyError, IndexError, AttributeError, ImportError, zipfile.BadZipFile
        If the content is damaged or holds anything else.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as members:
        described = members.infolist()
        if sum(one.file_size for one in described) > MAX_STORED_BYTES:
            raise ValueError("the stored result is too large")
        arrays = [
            np.lib.format.read_array(io.BytesIO(members.read(f"{number}.npy")), allow_pickle=False)
            for number in range(len(described) - 1)
        ]
        return _TreeReader(arrays).value(json.loads(members.read(_TREE)))


class _TreeWriter:
    """Turn values into a tree of JSON and a list of arrays; repeated ones are stored once."""

    def __init__(self) -> None:
        self.arrays: list[NDArray[Any]] = []
        self._numbers: dict[int, int] = {}
        # Without the objects, their ids could be given to others.
        self._objects: list[object] = []
        self._complete = 0

    def tree(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, Enum):
            return ["enum", _class_name(type(value)), value.name]
        if isinstance(value, np.ndarray | np.generic | bytes):
            return self._array(value)
        if isinstance(value, Path):
            return ["path", str(value)]
        if isinstance(value, Fraction):
            return ["fraction", value.numerator, value.denominator]
        if type(value) in (list, tuple, set, frozenset):
            return [type(value).__name__, *map(self.tree, value)]
        if type(value) is dict:
            return ["dict", *([self.tree(key), self.tree(held)] for key, held in value.items())]
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._object(value)
        raise TypeError(f"{type(value).__qualname__} can't be stored")

    def _array(self, value: Any) -> list[Any]:
        kind = "bytes" if isinstance(value, bytes) else "scalar"
        kind = "array" if isinstance(value, np.ndarray) else kind
        if id(value) not in self._numbers:
            self._numbers[id(value)] = len(self.arrays)
            self._objects.append(value)
            array = np.frombuffer(value, np.uint8) if kind == "bytes" else np.asarray(value)
            if array.dtype.hasobject:
                raise TypeError("arrays of objects can't be stored")
            self.arrays.append(array)
        return [kind, self._numbers[id(value)]]

    def _object(self, value: Any) -> list[Any]:
        if id(value) in self._numbers:
            return ["same", self._numbers[id(value)]]
        fields = {
            field.name: self.tree(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
        # Numbered when it is complete, in the order in which the reader completes them.
        self._numbers[id(value)] = self._complete
        self._complete += 1
        self._objects.append(value)
        return ["object", _class_name(type(value)), fields]


class _TreeReader:
    """Build values from a tree and arrays."""

    def __init__(self, arrays: list[NDArray[Any]]) -> None:
        self._arrays = arrays
        self._objects: list[Any] = []
        self._build: dict[str, Callable[..., Any]] = {
            "enum": self._enum,
            "bytes": lambda number: self._arrays[number].tobytes(),
            "scalar": lambda number: self._arrays[number][()],
            "array": lambda number: self._arrays[number],
            "path": Path,
            "fraction": Fraction,
            "list": lambda *items: [self.value(item) for item in items],
            "tuple": lambda *items: tuple(self.value(item) for item in items),
            "set": lambda *items: {self.value(item) for item in items},
            "frozenset": lambda *items: frozenset(self.value(item) for item in items),
            "dict": lambda *pairs: {self.value(key): self.value(held) for key, held in pairs},
            "same": lambda number: self._objects[number],
            "object": self._object,
        }

    def value(self, tree: Any) -> Any:
        if not isinstance(tree, list):
            return tree
        return self._build[tree[0]](*tree[1:])

    def _enum(self, name: str, member: str) -> Enum:
        found = _class_of(name)
        if not issubclass(found, Enum):
            raise TypeError(f"{name} is no enumeration")
        return found[member]

    def _object(self, name: str, held: dict[str, Any]) -> Any:
        found = _class_of(name)
        if not dataclasses.is_dataclass(found):
            raise TypeError(f"{name} is no dataclass")
        if held.keys() != {field.name for field in dataclasses.fields(found)}:
            raise TypeError(f"{name} has other fields")
        made = object.__new__(found)
        for field, tree in held.items():
            object.__setattr__(made, field, self.value(tree))
        self._objects.append(made)
        return made


def _class_name(kind: type) -> str:
    if kind.__module__.split(".")[0] not in OWN_PACKAGES or "<" in kind.__qualname__:
        raise TypeError(f"{kind.__qualname__} can't be stored")
    return f"{kind.__module__}:{kind.__qualname__}"


def _class_of(name: str) -> type:
    module, _, path = name.partition(":")
    if module.split(".")[0] not in OWN_PACKAGES:
        raise TypeError(f"{name} is not a class of this project")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = vars(found)[part]
    if not isinstance(found, type):
        raise TypeError(f"{name} is no class")
    return found
