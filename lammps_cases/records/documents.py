"""JSON documents that name their schema: one registry of the schemas, one reader, one writer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from eos_ref.errors import InputError
from lammps_cases.records.files import MIB, read_bytes, write_atomically

Kind = Literal[
    "run",
    "journal",
    "history",
    "baseline",
    "compare",
    "bisect",
    "chart",
    "stability",
    "stability-limits",
    "inputs",
    "adopt",
    "costs",
    "validate",
    "examples",
    "logs",
]
_VERSIONS: Mapping[Kind, int] = {
    "run": 2,
    "journal": 1,
    "history": 2,
    "baseline": 1,
    "compare": 1,
    "bisect": 1,
    "chart": 2,
    "stability": 1,
    "stability-limits": 1,
    "inputs": 1,
    "adopt": 1,
    "costs": 1,
    "validate": 1,
    "examples": 1,
    "logs": 1,
}
SCHEMAS: Mapping[Kind, str] = MappingProxyType({kind: f"eos-ref/{kind}/{n}" for kind, n in _VERSIONS.items()})

LARGEST = 512 * MIB  # of a run of 1e5 cases
INFINITE = ConfigDict(ser_json_inf_nan="strings")  # of documents with infinities or NaN, for which JSON has no numbers

T = TypeVar("T")


class _Header(BaseModel):
    """The first key of every document."""

    schema_: str | None = Field(None, alias="schema")


class Record(BaseModel):
    """A part of a document; keys that the model lacks are dropped."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True, **INFINITE)


@dataclass(frozen=True)
class Study:
    """The header of a study's document, which is the single source of page and tables.

    Attributes
    ----------
    engine : LAMMPS' own account of itself
    seconds : wall time of the whole study
    """

    __pydantic_config__ = INFINITE

    command: str
    machine: dict[str, str | float | int]
    engine: dict[str, str]
    quick: bool
    seconds: float

    @property
    def label(self) -> str:
        """The name of the LAMMPS that was measured."""
        return self.engine.get("distribution") or self.engine.get("version_string", "")

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The facts at the top of a page: LAMMPS, processor, time."""
        processor = f"{self.machine['processor']}, {self.machine['cores']} cores"
        took = f"{self.seconds:.0f} s" + (" (quick)" if self.quick else "")
        return [("LAMMPS", self.label), ("processor", processor), ("took", took)]


@dataclass(frozen=True)
class Document(Generic[T]):
    """A kind of document, as files hold it.

    Attributes
    ----------
    kind : its name in `SCHEMAS` and in complaints
    model : the class of its content, a pydantic model or a dataclass with the field ``schema``
    """

    kind: Kind
    model: type[T]

    @cached_property
    def _adapter(self) -> TypeAdapter[T]:
        return TypeAdapter(self.model)

    def text(self, content: T, exclude: Mapping[str, Any] | None = None) -> bytes:
        """Return the bytes of a document's file, without the fields to exclude."""
        left_out = None if exclude is None else dict(exclude)
        return self._adapter.dump_json(content, by_alias=True, indent=1, exclude=left_out) + b"\n"

    def plain(self, content: T) -> dict[str, Any]:
        """Return the document as JSON has it, for ``--json``."""
        document: dict[str, Any] = json.loads(self.text(content))
        return document

    def write(self, path: Path, content: T, exclude: Mapping[str, Any] | None = None) -> None:
        """Write a document, atomically."""
        write_atomically(path, self.text(content, exclude))

    def read(self, path: Path) -> T:
        """Read a document.

        Raises
        ------
        InputError
            The file cannot be read, is of another schema, or breaks a rule of this one: key and rule.
        """
        return self.parsed(read_bytes(path, self.kind, LARGEST), str(path))

    def parsed(self, content: bytes, where: str) -> T:
        """Parse the document of a file's bytes; raises as `read`."""
        try:
            schema = _Header.model_validate_json(content).schema_
            if schema != SCHEMAS[self.kind]:
                raise InputError("schema", f"must be {SCHEMAS[self.kind]}", schema, where)
            return self._adapter.validate_json(content)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"])) or "document"
            raise InputError(key, first["msg"], where=where) from None
