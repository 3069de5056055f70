"""LIGGGHTS (Debian ``liggghts``): spheres with ``model hertz``, Young's modulus and Poisson's ratio per type.

LIGGGHTS has no coefficient for a single contact: every body has a type of its own, with the modulus that gives its
contacts their stiffness. ``hard_particles yes`` is required above 1 GPa. The output is LIGGGHTS' own dump.
"""

import math
import os
import subprocess
import sys
import tempfile

from chain import arguments

chain, out = arguments()
radius, bodies, poisson = chain.radius(), len(chain.mass), 0.3
moduli = chain.moduli(radius, poisson)
volume = 4.0 / 3.0 * math.pi * radius**3
length = 2.0 * radius * bodies
script = f"""units si
atom_style granular
atom_modify map array sort 0 0.0
boundary f f f
newton off
communicate single vel yes
hard_particles yes
region box block {-4 * radius!r} {length + 2 * radius!r} {-4 * radius!r} {4 * radius!r} {-4 * radius!r} {4 * radius!r}
create_box {bodies} box
neighbor {radius!r} bin
neigh_modify delay 0 every 1 check yes
fix E all property/global youngsModulus peratomtype {" ".join(map(repr, moduli))}
fix nu all property/global poissonsRatio peratomtype {" ".join([repr(poisson)] * bodies)}
fix e all property/global coefficientRestitution peratomtypepair {bodies} {" ".join(["1.0"] * bodies**2)}
fix mu all property/global coefficientFriction peratomtypepair {bodies} {" ".join(["0.0"] * bodies**2)}
pair_style gran model hertz tangential off
pair_coeff * *
"""
for k in range(bodies):
    script += f"create_atoms {k + 1} single {2 * radius * k!r} 0.0 0.0\n"
    script += f"set atom {k + 1} diameter {2 * radius!r} density {chain.mass[k] / volume!r}\n"
    script += "velocity all set 0.0 0.0 0.0\n" if k == 0 else ""
for k, velocity in enumerate(chain.velocity):
    script += f"group b{k} id {k + 1}\nvelocity b{k} set {velocity!r} 0.0 0.0\ngroup b{k} delete\n"
script += f"""timestep {chain.dt!r}
fix move all nve/sphere
dump d all custom {chain.every} {os.path.abspath(out)} id type x y z vx vy vz radius mass
dump_modify d sort id format "%d %d %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g"
run {chain.samples * chain.every}
"""
with tempfile.TemporaryDirectory() as folder:
    with open(os.path.join(folder, "in.chain"), "w", encoding="utf-8") as file:
        file.write(script)
    run = subprocess.run(["liggghts", "-in", "in.chain"], cwd=folder, capture_output=True, text=True, check=False)
if run.returncode or "ERROR" in run.stdout:
    sys.exit(next((line for line in run.stdout.splitlines() if "ERROR" in line), "LIGGGHTS failed"))
