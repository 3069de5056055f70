"""A third party's integrator: ``ase.md.verlet.VelocityVerlet`` on a Calculator of ours for chains of contacts.

ASE: Larsen et al. 2017, *J. Phys.: Condens. Matter* 29, 273002. The method is that of LAMMPS and of the twin, on the
same steps, but written by others: what all three share cannot be a slip of one of them. ASE's integrator is unit-free
(it knows a step, masses, momenta and forces, and converts none of them), so SI numbers go straight through and nothing
is taken from ``ase.units``. Nor does it remove the drift of the centre of mass or touch momenta unless asked.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.steps import Dense, fixed_step_plan, read_off
from dem_bridge.errors import BackendUnavailable
from dem_bridge.foundation import progress
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory


class AseVerlet:
    """ASE's VelocityVerlet on displacements.

    >>> import dem_bridge as db
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> ase, twin = (db.solve(scene, backend=name, dt=2e-7, uncertainty=False) for name in ("ase", "verlet"))
    >>> bool(abs(ase.velocity - twin.velocity).max() < 1e-12)
    True
    """

    name = "ase"
    equations = "hertz"
    order: int | None = 2
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    )

    def availability(self) -> Availability:
        """Return whether ase is installed."""
        if importlib.util.find_spec("ase") is None:
            return Availability(False, "the package ase is not installed; install it by: pip install 'ase>=3.23'")
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve on the steps of the twin and LAMMPS.

        Raises BackendUnavailable where ASE is missing, RunBroken where velocities are not finite.
        """
        missing = self.availability().reason
        if missing:
            raise BackendUnavailable(f"{self.name} cannot run: {missing}")
        prescan = prescan_hertz(scene)
        plan = fixed_step_plan(scene, resolution, sampling, prescan)
        from ase import Atoms
        from ase.md.verlet import VelocityVerlet

        watch = Stopwatch()
        mass, bodies = np.array(scene.mass), scene.n_body
        momenta = np.zeros((bodies, 3))
        momenta[:, 0] = mass * scene.velocity
        # positions mean what the calculator says they mean: displacements from the start round least
        chain: Any = Atoms(numbers=np.zeros(bodies, dtype=int), positions=np.zeros((bodies, 3)), masses=mass)
        chain.set_momenta(momenta)
        calculator = chain_calculator(scene)
        chain.calc = calculator
        dynamics: Any = VelocityVerlet(chain, timestep=plan.step)
        looks = plan.dense_steps
        x, v, a = (np.zeros((len(looks), bodies + 1)) for _ in range(3))  # the last column: the walls, at rest
        overlap, force = (np.zeros((len(looks), scene.n_contact)) for _ in range(2))
        with np.errstate(over="ignore", invalid="ignore"):  # a run beyond stability is reported below
            for row, steps in enumerate(np.diff(looks, prepend=0).tolist()):
                if steps:
                    dynamics.run(steps)
                    progress.report(row / len(looks))
                a[row, :-1] = chain.get_forces()[:, 0] / mass
                x[row, :-1] = chain.arrays["positions"][:, 0]
                v[row, :-1] = chain.arrays["momenta"][:, 0] / mass
                overlap[row], force[row] = calculator.overlap, calculator.contact_force
        v[0, :-1] = scene.velocity  # momenta round it
        settings = {"dt": plan.step, "samples": plan.samples}
        dense = Dense(velocity=v, displacement=x, acceleration=a, overlap=overlap, force=force)
        run = read_off(self, scene, plan, dense, settings, watch=watch, evaluations=calculator.evaluations)
        versions = run.provenance["versions"] | {"ase": version("ase")}
        return replace(run, provenance={**run.provenance, "versions": versions})


def chain_calculator(scene: Scene) -> Any:
    """Return an ``ase.calculators.calculator.Calculator`` of the contacts and weights of ``scene``.

    Positions (first column) are displacements from the start in m, forces in N. After each calculation ``overlap``
    (m, negative: open) and ``contact_force`` (N), both ``(n_contact,)``, are those of the last positions.
    """
    from ase.calculators.calculator import Calculator

    contacts, bodies = scene.contacts, scene.n_body
    # along the line: place 0 is the left wall, then come the bodies and the right wall; contact k of the line is
    # between the places k and k + 1, and a wall that is not there is infinitely far away
    place = np.where(contacts.left == bodies, 0, contacts.left + 1)
    gap, stiffness, power = np.full(bodies + 1, np.inf), np.zeros(bodies + 1), np.ones(bodies + 1)
    gap[place], stiffness[place], power[place] = contacts.gap, contacts.stiffness, contacts.exponent - 1.0
    hertz, weight = bool(np.all(power[place] == 1.5)), scene.steady_force

    class Chain(Calculator):  # made here, so that the package can be imported without ASE
        def __init__(self) -> None:
            super().__init__()  # type: ignore[no-untyped-call]
            self.implemented_properties = ["forces"]
            self.evaluations, self.seen = 0, b""
            self.line, self.depth, self.law = np.zeros(bodies + 2), np.zeros(bodies + 1), np.zeros(bodies + 1)
            self.forces = np.zeros((bodies, 3))

        @property
        def overlap(self) -> NDArray[np.float64]:
            return self.depth[place]

        @property
        def contact_force(self) -> NDArray[np.float64]:
            return self.law[place]

        def check_state(self, atoms: Any, tol: float = 0.0) -> list[str]:
            # ASE takes positions within 1e-15 for the same and answers with the forces of before: in metres that is
            # motion, so only equal positions are the same. ASE asks three times a step; bytes compare soonest
            return [] if atoms.arrays["positions"].tobytes() == self.seen else ["positions"]

        def calculate(self, atoms: Any = None, properties: Any = ("forces",), system_changes: Any = ()) -> None:
            # Calculator.calculate would copy the Atoms and look for a folder, at each step
            positions = atoms.arrays["positions"]
            self.seen = positions.tobytes()
            line, depth, law = self.line, self.depth, self.law
            line[1:-1] = positions[:, 0]
            np.subtract(line[:-1], line[1:], out=depth)
            np.subtract(depth, gap, out=depth)
            pressed = np.maximum(depth, 0.0)
            if hertz:
                np.sqrt(pressed, out=law)
                np.multiply(law, pressed, out=law)
            else:
                np.power(pressed, power, out=law)
            np.multiply(law, stiffness, out=law)
            net = law[:-1] - law[1:]
            np.add(net, weight, out=self.forces[:, 0])
            self.results = {"forces": self.forces}  # ASE hands out copies
            self.evaluations += 1

    return Chain()
