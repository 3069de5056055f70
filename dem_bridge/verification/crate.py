"""Describe the folder of a report as an RO-Crate that follows the profile Process Run Crate.

The crate says which files the folder has, which program made them from which scenes and with which versions, and when.

References
----------
Soiland-Reyes et al. (2022), *Data Science* 5, 97; Leo et al. (2024), *PLoS ONE* 19, e0309210.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from dem_bridge.verification.verification import Verification

#: the file of a crate
NAME = "ro-crate-metadata.json"
_CONTEXT = "https://w3id.org/ro/crate/1.1/context"
_CONFORMS = ("https://w3id.org/ro/crate/1.1", "https://w3id.org/ro/wfrun/process/0.5")
_PAPER = "https://doi.org/10.1098/rsta.2017.0136"
_FORMATS = {
    "html": "text/html",
    "json": "application/json",
    "csv": "text/csv",
    "svg": "image/svg+xml",
}
_ACTION, _PROGRAM, _LAMMPS = "#verification", "#dem_bridge", "#lammps"


def crate(verification: Verification, files: Mapping[str, str | bytes]) -> str:
    """Return the content of ``ro-crate-metadata.json`` for the files of a report by name."""
    versions, lammps = verification.provenance["versions"], verification.provenance["lammps"]
    end = verification.provenance["date"].replace(" UTC", "Z").replace(" ", "T")
    scenes = {f"#scene-{study.scene.name}": study.scene for study in verification.studies}
    programs = [_PROGRAM, *([_LAMMPS] if lammps else [])]
    entities: list[dict[str, Any]] = [
        {
            "@id": NAME,
            "@type": "CreativeWork",
            "conformsTo": {"@id": _CONFORMS[0]},
            "about": {"@id": "./"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": verification.title,
            "description": _description(verification),
            "datePublished": end[:10],
            "license": {"@id": "https://spdx.org/licenses/MIT"},
            "conformsTo": {"@id": _CONFORMS[1]},
            "hasPart": [{"@id": name} for name in files],
            "mentions": [{"@id": _ACTION}],
            "citation": {"@id": _PAPER},
        },
        {
            "@id": _ACTION,
            "@type": "CreateAction",
            "name": "dem-bridge verify paper",
            "endTime": end,
            "instrument": {"@id": _PROGRAM},
            "object": [{"@id": name} for name in scenes],
            "result": [{"@id": name} for name in files],
            "description": f"accuracy {verification.accuracy:g}, wall time {verification.wall:.1f} s",
        },
        {
            "@id": _PROGRAM,
            "@type": "SoftwareApplication",
            "name": "dem_bridge",
            "softwareVersion": versions["dem_bridge"],
            "url": {"@id": "#codemeta"},
            "softwareRequirements": [{"@id": name} for name in programs[1:]],
            "runtimePlatform": ", ".join(f"{name} {value}" for name, value in versions.items() if name != "dem_bridge"),
        },
        {"@id": "#codemeta", "@type": "CreativeWork", "name": "codemeta.json of the project"},
        {"@id": "https://spdx.org/licenses/MIT", "@type": "CreativeWork", "name": "MIT License"},
        {"@id": _CONFORMS[1], "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"},
        {
            "@id": _PAPER,
            "@type": "ScholarlyArticle",
            "name": "Demonstration of accelerating and decelerating nonlinear impulse waves in functionally graded"
            " granular chains",
        },
    ]
    if lammps:
        entities.append(
            {
                "@id": _LAMMPS,
                "@type": "SoftwareApplication",
                "name": "LAMMPS",
                "softwareVersion": str(lammps["version"]),
                "url": "https://www.lammps.org",
            }
        )
    entities += [
        {
            "@id": name,
            "@type": "CreativeWork",
            "name": scene.name,
            "description": scene.description,
            "identifier": f"sha256:{scene.content_hash}",
        }
        for name, scene in scenes.items()
    ]
    entities += [_file(name, content) for name, content in files.items()]
    return json.dumps({"@context": _CONTEXT, "@graph": entities}, indent=1, ensure_ascii=False) + "\n"


def _description(verification: Verification) -> str:
    """Return the abstract as one paragraph, or the answer without one."""
    points = (point for part in verification.abstract for point in part.points)
    return " ".join(points if verification.abstract else verification.answer)


def _file(name: str, content: str | bytes) -> dict[str, Any]:
    """Return the entity of a file."""
    data = content if isinstance(content, bytes) else content.encode()
    return {
        "@id": name,
        "@type": "File",
        "name": name,
        "encodingFormat": _FORMATS.get(name.rsplit(".", 1)[-1], "application/octet-stream"),
        "contentSize": str(len(data)),
        "sha256": hashlib.sha256(data).hexdigest(),
    }
