"""Runs of the study of the paper: the scenes that go through each backend, and their results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from dem_bridge.backends.base import BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.file.conversion import rounded
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.effects import STRONG, VARIANTS
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import assign_roles

#: the paper's own chains: verified in full, with refinement levels
DECELERATING, ACCELERATING = "decelerating-40", "accelerating-40"
MAIN = (DECELERATING, ACCELERATING)
LONG = ("decelerating-200", "accelerating-200")
#: accuracy of all other scenes, of which the claims need no more digits
OTHER_ACCURACY = 1e-4
#: backends that verifications of scenes run
IN_ROLES = ("lammps-granular", "lammps-table", "verlet", "reference", "scipy", "bca")
#: further backends: an external integrator, one of order 4, the paper's method, and the more accurate theory
BESIDE = {
    "ase": Resolution(dt=1e-7),
    "blanes-moan": Resolution(),
    "ode45": Resolution(),
    "adiabatic": Resolution(),
}
#: ... and every other backend that has no role in a verification, with its default settings
BESIDE |= {name: Resolution() for name in BACKENDS if name not in (*BESIDE, *IN_ROLES)}
#: backends whose values the claims list, in this order
JUDGES = (REFERENCE, "lammps", "ode45", "bca", "adiabatic")
#: mass gradients of figure 6, and the step of LAMMPS on them
#: variants whose velocities are compared cylinder by cylinder
WEIGHED = ("base", "gravity")
GRADIENTS = tuple(round(0.0025 * i, 4) for i in range(-8, 9))
COARSE = Resolution(dt=1e-7)


@dataclass(frozen=True, eq=False)
class Runs:
    """Hold all runs of the study: the main run of each backend on each scene, by their names."""

    scenes: Mapping[str, Scene]
    results: Mapping[tuple[str, str], Result]

    @classmethod
    def of(cls, results: Iterable[Result]) -> Runs:
        """Return the runs among some results; of each scene and backend the first is the main one."""
        matches: dict[tuple[str, str], Result] = {}
        for result in results:
            matches.setdefault((result.case.scene.name, result.case.backend), result)
        # claims on printed numbers are about the paper's chains, whether or not these have run
        scenes = {name: load_scene(name) for name in MAIN}
        return cls(scenes | {result.case.scene.name: result.case.scene for result in matches.values()}, matches)

    def run(self, scene: str, name: str) -> Trajectory | None:
        """Return the run of a scene by a backend; "lammps" stands for the LAMMPS backend of that scene."""
        if name == "lammps":
            name = assign_roles(self.scenes[scene]).engine
        result = self.results.get((scene, name))
        if result is None and name == SCIPY == assign_roles(self.scenes[scene]).solver:
            return self.truth(scene)
        return None if result is None else result.trajectory

    def truth(self, scene: str) -> Trajectory | None:
        """Return the run of a scene by the reference."""
        return self.run(scene, REFERENCE)

    def judges(self, scene: str) -> Iterator[tuple[str, Trajectory]]:
        """Yield the runs of a scene by :data:`JUDGES`, with their names."""
        for name in JUDGES:
            if scene in self.scenes and (run := self.run(scene, name)) is not None:
                yield name, run

    def has(self, scene: str) -> bool:
        """Return whether the reference has run on a scene."""
        return scene in self.scenes and self.truth(scene) is not None

    def by_backend(self, scene: str) -> dict[str, Trajectory]:
        """Return all runs of one scene."""
        return {
            name: result.trajectory
            for (of, name), result in self.results.items()
            if of == scene and result.trajectory is not None
        }


def scenes_of_paper(names: Sequence[str] | None = None) -> list[Scene]:
    """Return the shipped scenes, or those with these names; the paper's two come first."""
    available = shipped_scenes() if names is None else names
    return [load_scene(name) for name in sorted(available, key=lambda name: (name not in MAIN, name))]


def beside(scene: Scene) -> Iterator[Case]:
    """Yield the cases of :data:`BESIDE` that support a scene."""
    sampling = Sampling(count=scene.samples)
    for name, resolution in BESIDE.items():
        if supports_of(name).covers(scene):
            # codes with a fixed step take further runs for an uncertainty, which no table shows
            estimated = backend(name).order is None
            yield Case(scene=scene, backend=name, resolution=resolution, sampling=sampling, uncertainty=estimated)


def quick(
    scenes: Sequence[Scene], names: Sequence[str] = (REFERENCE,), *, samples: int = 1, uncertainty: bool = False
) -> list[Case]:
    """Return cases with few samples, for peak forces and crossing times, or one number."""
    return [
        Case(
            scene=scene,
            backend=name,
            resolution=COARSE,
            sampling=Sampling(count=samples),
            uncertainty=uncertainty,
        )
        for scene in scenes
        for name in names
    ]


def variants() -> list[Case]:
    """Return the cases of the paper's chains with one change each; those with weight have velocities, too."""
    cases = []
    for scene in map(load_scene, MAIN):
        for variant in (*VARIANTS, STRONG):
            cases += quick([variant.of(scene)], samples=scene.samples if variant.id in WEIGHED else 1)
    return cases


def with_mass_gradient(scene: Scene, gamma: float) -> Scene:
    """Return a scene with masses m_i = m (1 + gamma i) for i = 1, 2, ... (appendix A), and the same striker."""
    masses = (rounded(scene.mass[1] * (1.0 + gamma * i)) for i in range(1, scene.n_body))
    return replace(scene, name=f"{scene.name}.gamma{gamma:g}", mass=(scene.mass[0], *masses), geometry=None)


def mass_gradients(engine: Engine | None = None) -> list[Case]:
    """Return the cases of both chains at every mass gradient of figure 6, of LAMMPS at every second one."""
    cases = []
    for scene in map(load_scene, MAIN):
        scenes = [with_mass_gradient(scene, gamma) for gamma in GRADIENTS]
        cases += quick(scenes, (REFERENCE, "ode45", "bca", "adiabatic"))
        cases += [replace(case, engine=engine) for case in quick(scenes[::2], ("lammps-granular",))]
    return cases


#: what the paper changes for figure 4 so that one wave remains (section 4b), both together and each alone
MATCHED: Mapping[str, Callable[[Scene], Scene]] = {
    "matched": lambda s: replace(s, mass=(s.mass[1], *s.mass[1:]), stiffness=(s.stiffness[1], *s.stiffness[1:])),
    "matched-mass": lambda s: replace(s, mass=(s.mass[1], *s.mass[1:])),
    "matched-stiffness": lambda s: replace(s, stiffness=(s.stiffness[1], *s.stiffness[1:])),
}


#: the accelerating chain with the decelerating one's ratio of beta_0 to beta_1 (section 4a, small mismatch)
MISMATCHED = "mismatched-stiffness"


def matched() -> list[Case]:
    """Return cases of both chains with other first contacts and strikers, which test the cause of further fronts.

    The decelerating chain has a stiffer first contact, a heavier striker, and both; the accelerating one has a softer
    first contact.
    """
    scene, other = map(load_scene, MAIN)
    scenes = [replace(change(scene), name=f"{scene.name}.{key}") for key, change in MATCHED.items()]
    soft = rounded(other.stiffness[1] * scene.stiffness[0] / scene.stiffness[1])
    scenes.append(replace(other, name=f"{other.name}.{MISMATCHED}", stiffness=(soft, *other.stiffness[1:])))
    return quick(scenes, samples=scene.samples)


#: ratio of each sphere's radius to the one before, and samples: pulses get as short as the last spheres are small
STEEPER = {0.95: 4000, 0.9: 8000}
#: tapered chain -> by how much radii fall from sphere to sphere
TAPERS = {"tapered-forward": "2 %", "tapered-forward.5-percent": "5 %", "tapered-forward.10-percent": "10 %"}


def steeper_taper(scene: Scene, ratio: float) -> Scene:
    """Return a tapered chain with another ratio of radii, from one whose striker is as large as the first sphere.

    Masses are proportional to R^3, stiffnesses to the square root of R R'/(R + R').
    """
    radii = [1.0, *(ratio**i for i in range(scene.n_body - 1))]
    return replace(
        scene,
        name=f"tapered-forward.{100.0 * (1.0 - ratio):.3g}-percent",
        mass=tuple(rounded(scene.mass[0] * r**3) for r in radii),
        stiffness=tuple(rounded(scene.stiffness[0] * (2.0 * r * s / (r + s)) ** 0.5) for r, s in pairwise(radii)),
        geometry=None,
    )


def steeper_tapers() -> list[Case]:
    """Return cases of chains that taper more than the shipped ones."""
    scene = load_scene("tapered-forward")
    return [
        case
        for q, samples in STEEPER.items()
        for case in quick([steeper_taper(scene, q)], samples=samples, uncertainty=True)
    ]
