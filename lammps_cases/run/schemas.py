"""The published JSON schemas, generated from the models: ``python -m lammps_cases.run.schemas`` writes them.

``scene.schema.json`` helps editors with case files, ``run.schema.json`` describes run.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import RunRecord
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import CaseFile

FOLDER = Path(__file__).parents[1]


def scene_schema() -> dict[str, Any]:
    """Return the schema of a case file; the scene's keys are optional, as patches of the matrix may provide them."""
    file, scene = CaseFile.model_json_schema(), Scene.model_json_schema()
    definitions = scene.pop("$defs")
    scene.pop("required")
    # In a patch null removes a key.
    properties = {key: {"anyOf": [schema, {"type": "null"}]} for key, schema in scene["properties"].items()}
    patch = {**scene, "properties": properties, "additionalProperties": True, "title": "Patch"}
    file["$defs"] = {**definitions, "Scene": scene, "Patch": patch}
    file["properties"]["scene"] = {"$ref": "#/$defs/Scene"}
    axis = {"type": "object", "additionalProperties": {"$ref": "#/$defs/Patch"}}
    file["properties"]["matrix"]["additionalProperties"] = axis
    # A patch gives parts of a complete scene: none of its objects is complete. But a list of particles has x or
    # types, and a data file its name: without them, a spacing and periodic are those of a lattice.
    for definition in (
        "Lattice",
        "FromXYZ",
        "FromDump",
        "LawSettings",
        "AtomType",
        "Evolve",
        "SurfaceDetectionSettings",
    ):
        definitions[definition].pop("required", None)
    definitions["Listed"].pop("required")
    definitions["Listed"]["anyOf"] = [{"required": ["x"]}, {"required": ["types"]}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "eos-ref case file", **file}


def run_schema() -> dict[str, Any]:
    """Return the schema of run.json; numbers that are not finite are written as strings."""
    schema = _with_infinities(RunRecord.model_json_schema(by_alias=True, mode="serialization"))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _with_infinities(schema: Any) -> Any:
    """Admit, wherever a number is allowed, the text written for NaN and infinity."""
    if isinstance(schema, list):
        return [_with_infinities(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "number":
        rest = {key: value for key, value in schema.items() if key not in ("type", "title", "description")}
        either = [{"type": "number", **rest}, {"enum": ["Infinity", "-Infinity", "NaN"]}]
        return {"anyOf": either, **{key: schema[key] for key in ("title", "description") if key in schema}}
    return {key: _with_infinities(value) for key, value in schema.items()}


def documents() -> dict[Path, str]:
    """Return the schema files and their content."""
    schemas = {"scene/scene.schema.json": scene_schema(), "records/run.schema.json": run_schema()}
    return {FOLDER / name: json.dumps(schema, indent=1, sort_keys=True) + "\n" for name, schema in schemas.items()}


if __name__ == "__main__":
    for path, content in documents().items():
        write_atomically(path, content)
