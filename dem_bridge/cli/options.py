"""The arguments and options that several commands have, each declared once.

A command takes them as they are, or with another help by :func:`dataclasses.replace`. Choices are written here, because
``--help`` must not import numpy; a test compares them with the package.
"""

from __future__ import annotations

from dataclasses import replace

from dem_bridge.cli.parameters import (
    ACCURACIES,
    COUNTS,
    FILE,
    POSITIVE,
    Argument,
    BackendChoice,
    Cluster,
    Option,
    scene_names,
    variable,
)

# what a command works on
SCENE = Argument("scene", completion=scene_names)
SCENES = Argument("scenes", "[SCENE]...", many=True, completion=scene_names)

# how finely, at which times
DT = Option("dt", "Upper bound of the time step, s.", float, unit="s", limits=POSITIVE)
ACCURACY = Option(
    "accuracy",
    "Accuracy of velocities, relative to the largest velocity; the time step follows from it.",
    float,
    metavar="A",
    limits=ACCURACIES,
)
SAMPLES = Option("samples", "Number of samples in time.", int, metavar="N", limits=COUNTS, default="that of the scene")
DURATION = Option("duration", "Duration, s.", float, unit="s", limits=POSITIVE)

# which code, which LAMMPS, which deck
BACKEND = Option("backend", "Backend that solves the scene.", BackendChoice(), default="reference")
LAMMPS = (
    Option("lmp", "LAMMPS binary.", metavar="PATH", default="$DEM_BRIDGE_LMP, or the Python module lammps"),
    Option("lmp_args", 'Further arguments of LAMMPS, such as "-sf omp".', metavar="ARGS"),
    Option("python", "Python interpreter of another environment whose module lammps is used.", metavar="PATH"),
    Option("ranks", "Number of MPI processes of one run.", int, metavar="R", limits=COUNTS, default="1"),
)
GEOMETRY = Option(
    "geometry",
    "Radius of the bodies in the deck: a small power of two, which minimises round-off, or the scene's radius.",
    ("surrogate", "physical"),
    default="surrogate",
)
TYPES = Option(
    "types",
    "Atom types of the deck: as few as possible, or one per body.",
    ("euler", "per-body"),
    default="euler",
)
VARIABLES = Option(
    "variables",
    "Value of a variable of the script, as LAMMPS accepts it by -var; can be repeated.",
    variable,
    metavar="NAME=VALUE",
    flags=("--var",),
    many=True,
)
TIME_LIMIT = Option(
    "time_limit", "Time limit of each run of LAMMPS, s.", float, unit="s", limits=POSITIVE, default="600"
)

# where many runs are made
JOBS = Option(
    "jobs",
    "Number of runs at the same time.",
    int,
    metavar="N",
    limits=COUNTS,
    default="the number of cores",
    flags=("-j",),
)
CLUSTER = Option(
    "executor",
    "Dask scheduler, or its scheduler file, on whose workers the runs are made, in place of -j.",
    Cluster(),
    metavar="ADDRESS|FILE",
    flags=("--cluster",),
)
RECOMPUTE = Option("recompute", "Recompute all runs, also those in the store.", bool, flags=("--no-cache",))

# files of other programs
SCENE_OF_FILE = Option("scene", "Scene of the run; needed for every file that is not netCDF.", metavar="SCENE")
DT_OF_FILE = Option(
    "dt",
    "Time step, s, if the file has step numbers but no times (without step numbers: time between frames).",
    float,
    unit="s",
    limits=POSITIVE,
)
UNITS = Option(
    "units",
    "Units, if the file does not state them.",
    ("si", "cgs", "micro", "nano", "metal", "real", "ase"),
    default="si; for .traj: ase",
)

# what is written and printed
FOLDER = Option("folder", "Write the page, tables and figures into DIR.", FILE, metavar="DIR", flags=("-o",))
OUTPUT = Option("output", "File to write.", FILE, metavar="FILE", flags=("-o",))
FORCE = Option("force", "Replace FILE if it exists.", bool)
JSON_FILE = Option("json_file", "File for the result, JSON.", FILE, metavar="FILE", flags=("--json",))
JUNIT_FILE = Option("junit_file", "File for the result, JUnit XML.", FILE, metavar="FILE", flags=("--junit",))
AS_JSON = Option("as_json", "Print JSON.", bool, flags=("--json",))
JSON_PROGRESS = Option("json_progress", "Print the progress as lines of JSON on stderr.", bool)
VERBOSE = Option("verbose", "Print tables, notes and reasons before the answer.", bool, flags=("-v", "--verbose"))

# a scene file that is written
SCENE_FILE = (
    replace(OUTPUT, help="Scene file to write, .toml.", required=True),
    FORCE,
    Option("name", "Name of the scene.", metavar="NAME", default="the name of the file that is read"),
    Option("description", "Description of the scene in one line.", metavar="TEXT"),
)
