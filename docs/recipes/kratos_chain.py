"""Kratos (PyPI ``KratosDEMApplication``): spheres with DEM_D_Hertz_viscous_Coulomb, a material for each body.

The default of Kratos, ``Symplectic_Euler``, is of first order in velocities. With a fourth argument ``Velocity_Verlet``
that scheme is used.
"""

import json
import math
import os
import sys
import tempfile

from chain import arguments, write_csv

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before Kratos is imported; threads are slower for so few bodies
chain, out = arguments()
out, scheme = os.path.abspath(out), (sys.argv[4:] or ["Symplectic_Euler"])[0]
radius, bodies, poisson = chain.radius(), range(len(chain.mass)), 0.3
volume = 4.0 / 3.0 * math.pi * radius**3
names = [f"body{k}" for k in bodies]
materials = [
    {
        "material_name": names[k],
        "material_id": k + 1,
        "Variables": {
            "PARTICLE_DENSITY": chain.mass[k] / volume,
            "YOUNG_MODULUS": modulus,
            "POISSON_RATIO": poisson,
            "PARTICLE_SPHERICITY": 1.0,
        },
    }
    for k, modulus in enumerate(chain.moduli(radius, poisson))
]
contact = {
    "DEM_DISCONTINUUM_CONSTITUTIVE_LAW_NAME": "DEM_D_Hertz_viscous_Coulomb",
    "STATIC_FRICTION": 0.0,
    "DYNAMIC_FRICTION": 0.0,
    "FRICTION_DECAY": 500,
    "COEFFICIENT_OF_RESTITUTION": 1.0,
    "ROLLING_FRICTION": 0.0,
    "ROLLING_FRICTION_WITH_WALLS": 0.0,
    "DEM_ROLLING_FRICTION_MODEL_NAME": "DEMRollingFrictionModelConstantTorque",
}
pairs = [(j, k) for k in bodies for j in range(k + 1)]
relations = [
    {"material_names_list": [names[j], names[k]], "material_ids_list": [j + 1, k + 1], "Variables": contact}
    for j, k in pairs
]
parameters = {
    "problem_name": "chain",
    "dem_inlet_option": False,
    "GravityZ": 0.0,
    "RotationOption": False,
    "SearchTolerance": 0.1 * radius,
    "NeighbourSearchFrequency": 1,
    "TranslationalIntegrationScheme": scheme,
    "MaxTimeStep": chain.dt,
    "FinalTime": chain.duration,
    "do_print_results_option": False,
    "solver_settings": {
        "strategy": "sphere_strategy",
        "RemoveBallsInitiallyTouchingWalls": False,
        "material_import_settings": {"materials_filename": "materials.json"},
    },
}


def block(kind, lines):
    """Return a block of Kratos' input."""
    return "\n".join([f"Begin {kind}", *lines, f"End {kind.split()[0]}", ""])


mesh = block("ModelPartData", []) + block("Properties 0", [])
mesh += block("Nodes", [f"{k + 1} {2.0 * radius * k!r} 0.0 0.0" for k in bodies])
mesh += block("Elements SphericParticle3D", [f"{k + 1} 0 {k + 1}" for k in bodies])
mesh += block("NodalData RADIUS", [f"{k + 1} 0 {radius!r}" for k in bodies])
for k in bodies:
    parts = block("SubModelPartNodes", [f"{k + 1}"]) + block("SubModelPartElements", [f"{k + 1}"])
    mesh += block(f"SubModelPart {names[k]}", [parts])

with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
    for name, content in (
        ("chainDEM.mdpa", mesh),
        ("chainDEM_FEM_boundary.mdpa", block("ModelPartData", [])),
        (
            "materials.json",
            json.dumps(
                {
                    "materials": materials,
                    "material_relations": relations,
                    "material_assignation_table": [[f"SpheresPart.{name}", name] for name in names],
                }
            ),
        ),
    ):
        with open(name, "w", encoding="utf-8") as file:
            file.write(content)

    import KratosMultiphysics as Kratos
    from KratosMultiphysics.DEMApplication.DEM_analysis_stage import DEMAnalysisStage

    stage = DEMAnalysisStage(Kratos.Model(), Kratos.Parameters(json.dumps(parameters)))
    stage.Initialize()
    nodes = sorted(stage.spheres_model_part.Nodes, key=lambda node: node.Id)
    for node, speed in zip(nodes, chain.velocity, strict=True):
        node.SetSolutionStepValue(Kratos.VELOCITY_X, speed)
    time, displacement, velocity = [], [], []
    for step in range(chain.samples * chain.every + 1):
        if step:
            stage.time = stage._AdvanceTime()
            stage.InitializeSolutionStep()
            stage._GetSolver().Predict()
            stage._GetSolver().SolveSolutionStep()
            stage.FinalizeSolutionStep()
        if step % chain.every == 0:
            time.append(step * chain.dt)
            displacement.append([node.X - 2.0 * radius * k for k, node in enumerate(nodes)])
            velocity.append([node.GetSolutionStepValue(Kratos.VELOCITY_X) for node in nodes])
    write_csv(out, time, displacement, velocity)
