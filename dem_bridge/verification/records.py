"""Write a verification for other programs: its folder as an RO-Crate, verdicts and regressions as JUnit XML.

The crate follows the profile Process Run Crate. It says which files the folder has, which program made them from which
scenes and with which versions, and when.

References
----------
Soiland-Reyes et al. (2022), *Data Science* 5, 97; Leo et al. (2024), *PLoS ONE* 19, e0309210.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dem_bridge.observables.verdict import Verdict
from dem_bridge.report.junit import junit_xml
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.verification import Verification

if TYPE_CHECKING:
    from dem_bridge.verification.regression.compare import Comparison

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
    scenes = {f"#scene-{study.scene.name}": study.scene for study in verification.studies}
    entities = [
        *_report(verification, files),
        _action(verification, list(scenes), list(files)),
        *_programs_and_sources(verification),
        *(_scene(name, scene) for name, scene in scenes.items()),
        *(_file(name, content) for name, content in files.items()),
    ]
    return json.dumps({"@context": _CONTEXT, "@graph": entities}, indent=1, ensure_ascii=False) + "\n"


def _report(verification: Verification, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return the entities of the crate itself and of the folder that it describes, which has files of these names."""
    return [
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
            "datePublished": _end(verification)[:10],
            "license": {"@id": "https://spdx.org/licenses/MIT"},
            "conformsTo": {"@id": _CONFORMS[1]},
            "hasPart": _references(names),
            "mentions": [{"@id": _ACTION}],
            "citation": {"@id": _PAPER},
        },
    ]


def _action(verification: Verification, scenes: Iterable[str], files: Iterable[str]) -> dict[str, Any]:
    """Return the entity of the verification, which made the files from the scenes; both are identifiers."""
    return {
        "@id": _ACTION,
        "@type": "CreateAction",
        "name": "dem-bridge verify paper",
        "endTime": _end(verification),
        "instrument": {"@id": _PROGRAM},
        "object": _references(scenes),
        "result": _references(files),
        "description": f"accuracy {verification.accuracy:g}, wall time {verification.wall:.1f} s",
    }


def _programs_and_sources(verification: Verification) -> list[dict[str, Any]]:
    """Return the entities of the programs, the license, the profile and the paper; LAMMPS is the last, if it ran."""
    versions, lammps = verification.provenance["versions"], verification.provenance["lammps"]
    entities: list[dict[str, Any]] = [
        {
            "@id": _PROGRAM,
            "@type": "SoftwareApplication",
            "name": "dem_bridge",
            "softwareVersion": versions["dem_bridge"],
            "url": {"@id": "#codemeta"},
            "softwareRequirements": _references([_LAMMPS] if lammps else []),
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
    return entities


def _scene(name: str, scene: Scene) -> dict[str, Any]:
    """Return the entity of a scene under an identifier."""
    return {
        "@id": name,
        "@type": "CreativeWork",
        "name": scene.name,
        "description": scene.description,
        "identifier": f"sha256:{scene.content_hash}",
    }


def _references(names: Iterable[str]) -> list[dict[str, str]]:
    """Return references to entities by their identifiers."""
    return [{"@id": name} for name in names]


def _end(verification: Verification) -> str:
    """Return when the verification ended, in the form of ISO 8601."""
    return str(verification.provenance["date"]).replace(" UTC", "Z").replace(" ", "T")


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


def junit(verdicts: Sequence[Verdict]) -> str:
    """Return JUnit XML with a test case per verdict."""
    return junit_xml(
        (v.scene, f"{v.quantity}: {v.backend} against {v.reference}", v.outcome, v.sentence) for v in verdicts
    )


def regression_junit(comparisons: Sequence[Comparison]) -> str:
    """Return JUnit XML with a test case per comparison with a baseline."""
    return junit_xml(
        (c.scene, f"{c.backend}: same as its baseline", c.change, "; ".join([c.sentence, *c.notes]))
        for c in comparisons
    )
