"""Turn the columns or arrays of a file into a record: times, units and bodies are recognised here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.column_meaning import Choices, meanings_of
from dem_bridge.formats.readers.headings import Heading
from dem_bridge.formats.readers.record import QUANTITIES, Draft
from dem_bridge.formats.readers.rounding import counted_times, numbers, scaled, step_of
from dem_bridge.formats.readers.tables import Entry, Table
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: quantities that have a column for each body or contact
_SAMPLED = (*QUANTITIES, "position", "force_left", "force_right")


def draft_of_table(name: str, table: Table, scene: Scene, choices: Choices) -> Draft:
    """Return the draft of a record from the columns or arrays of a file."""
    notes = list(table.notes)
    assigned = meanings_of(table, scene, choices, notes)
    time, time_rounding, dt = _times(assigned, table, choices, notes)
    if empty := [entry.heading for _, entry in assigned if not entry.values.size]:
        raise UsageError(f"{empty[0]!r} has no values; allowed: a value for each of two or more times")
    draft = Draft(name=name, time=time, time_rounding=time_rounding, dt=dt, notes=notes)
    draft.headings = tuple(entry.heading for entry in table.entries)
    blocks = {
        quantity: [(heading, entry) for heading, entry in assigned if heading.quantity == quantity]
        for quantity in _SAMPLED
    }
    blocks = {quantity: block for quantity, block in blocks.items() if block}
    pairs = [pair for block in blocks.values() for pair in block]
    wide = any(entry.values.ndim > 1 or heading.index is not None for heading, entry in pairs)
    bodies = [entry for heading, entry in assigned if heading.quantity == "body"]
    bodies.sort(key=lambda entry: entry.heading.lower().startswith("contact"))
    if bodies and not wide and bodies[0].values.shape == (len(time),):
        sampled = _long(draft, bodies[0], blocks, scene, choices)
    else:
        ids = _ids(bodies, blocks) if wide else None
        sampled = {quantity: _wide(draft, quantity, block, ids, scene, choices) for quantity, block in blocks.items()}
    _add(draft, sampled, scene)
    return draft


def _times(
    assigned: list[tuple[Heading, Entry]], table: Table, choices: Choices, notes: list[str]
) -> tuple[Floats, Floats, float | None]:
    """Return the times of the rows with their rounding errors, and the time step."""
    dt = choices.dt if choices.dt is not None else table.dt
    times = [(heading, entry) for heading, entry in assigned if heading.quantity == "time"]
    steps = next((entry for heading, entry in assigned if heading.quantity == "step"), None)
    if times:
        heading, entry = times[0]
        unit = choices.scale("time", heading.unit or entry.unit)
        time, rounding = scaled(*numbers(np.ravel(entry.values)), unit)
        if dt is None and steps is not None and steps.values.shape == time.shape:
            number = numbers(steps.values)[0]
            # a table with a row for each body repeats both
            rows = np.sort(np.unique(np.stack([number, time]), axis=1, return_index=True)[1])
            dt = step_of(time[rows], rounding[rows], number[rows], notes)
        if steps is not None and steps.values.shape == time.shape:
            time, rounding = counted_times(time, rounding, numbers(steps.values)[0], dt, notes)
        return time, rounding, dt
    if steps is not None and dt is not None:
        notes.append(f"times are step numbers times the time step of {dt:.9g} s")
        values = numbers(np.ravel(steps.values))[0] * dt
        return values, 0.5 * np.spacing(values), dt
    said = "no times; name their column (--columns), such as 'time [s]'"
    if steps is not None:
        said = "step numbers but no times; give the time step in s (FILE@DT)"
    raise UsageError(f"the file has {said}; its columns are {', '.join(repr(e.heading) for e in table.entries[:20])}")


def _ids(bodies: list[Entry], blocks: dict[str, list[tuple[Heading, Entry]]]) -> list[int] | None:
    """Return the bodies of the columns of arrays, which are sorted by them if every row has its own order."""
    if not bodies:
        return None
    ids = numbers(bodies[0].values)[0].astype(np.int64)
    if ids.ndim == 1:
        return [int(each) for each in ids]
    order = np.argsort(ids, axis=1, kind="stable")
    ids = np.take_along_axis(ids, order, axis=1)
    if np.any(ids != ids[0]):
        raise UsageError(f"{bodies[0].heading!r} has other bodies at other times; allowed: always the same")
    for block in blocks.values():
        for _, entry in block:
            if entry.values.shape == ids.shape:
                entry.values = np.take_along_axis(entry.values, order, axis=1)
    return [int(each) for each in ids[0]]


def _wide(
    draft: Draft,
    quantity: str,
    block: list[tuple[Heading, Entry]],
    ids: list[int] | None,
    scene: Scene,
    choices: Choices,
) -> tuple[Floats, Floats, tuple[int, ...]]:
    """Return the values, rounding errors and bodies of a quantity with a column for each body (contact)."""
    n_t = len(draft.time)
    arrays, indices = [], list[int | None]()
    for heading, entry in block:
        array = entry.values
        if array.ndim == 2 and array.shape[0] != n_t and array.shape[1] == n_t:
            array = array.T
            draft.notes.append(f"{entry.heading} has a row for each body and is transposed")
        if array.ndim == 0 or array.ndim > 2 or array.shape[0] != n_t:
            raise UsageError(
                f"{entry.heading!r} has the shape {array.shape}, the times have {n_t}; allowed: a value for each"
                " time, or a row for each time"
            )
        arrays.append(array.reshape(n_t, -1))
        width = array.shape[1] if array.ndim == 2 else 0
        stated = ids is not None and len(ids) == width and quantity != "contact_force"
        indices += [heading.index] if array.ndim == 1 else ids if ids is not None and stated else [*range(width)]
    texts = np.hstack(arrays)
    heading, entry = block[0]
    scales = np.hstack(
        [
            np.full(a.shape[1], choices.scale(quantity, h.unit or e.unit))
            for a, (h, e) in zip(arrays, block, strict=True)
        ]
    )
    values, rounding = numbers(texts)
    columns = _columns(draft, quantity, indices, scene, choices)
    return *_each_scaled(values, rounding, scales), columns


def _each_scaled(values: Floats, rounding: Floats, scales: Floats) -> tuple[Floats, Floats]:
    """Return numbers times the unit of each column, and their rounding errors."""
    unit = float(scales[0])
    if np.all(scales == unit):
        return scaled(values, rounding, unit)
    parts = [scaled(values[:, k], rounding[:, k], float(unit)) for k, unit in enumerate(scales)]
    return np.stack([part[0] for part in parts], axis=1), np.stack([part[1] for part in parts], axis=1)


def _columns(
    draft: Draft,
    quantity: str,
    indices: Sequence[int | None],
    scene: Scene,
    choices: Choices,
    *,
    from_one: bool = False,
) -> tuple[int, ...]:
    """Return the body (contact) of each column from the indices in the headings.

    ``from_one``: indices that begin with 1 are those of atoms, which count from 1 also where the last one is missing.
    """
    of_contacts = quantity == "contact_force"
    count, kind = (scene.n_contact, "contact") if of_contacts else (scene.n_body, "body")
    if choices.bodies is not None and not of_contacts:
        if len(choices.bodies) != len(indices):
            raise UsageError(
                f"{len(choices.bodies)} bodies were given, the file has {len(indices)} columns of {quantity}; give the"
                " body of each column, in their order"
            )
        return tuple(choices.bodies)
    numbered = [index for index in indices if index is not None]
    if not numbered:
        if len(indices) != count:
            raise UsageError(
                f"the file has {len(indices)} columns of {quantity} without the number of a {kind}, the scene"
                f" {scene.name} has {count}; number the headings, such as {quantity}_3, or give the"
                " bodies of the columns (--bodies)"
            )
        return tuple(range(count))
    if len(numbered) != len(indices):
        raise UsageError(f"only some columns of {quantity} have the number of a {kind}; allowed: all or none")
    first = 1 if min(numbered) == 1 and (max(numbered) == count or (from_one and max(numbered) < count)) else 0
    if first:
        draft.notes.append(f"the columns of {quantity} count from 1: {kind} 0 of the scene is number 1 of the file")
    if len({*numbered}) < count:
        absent = [str(k + first) for k in range(count) if k + first not in numbered]
        kinds = "contacts" if of_contacts else "bodies"
        some = f"{', '.join(absent[:8])}{' and others' if len(absent) > 8 else ''}"
        missing = f"{kind} {some} is missing" if len(absent) == 1 else f"{kinds} {some} are missing"
        draft.notes.append(
            f"the file has the {quantity} of {len(numbered)} of {count} {kinds}, counted from {first}; {missing}"
        )
    return tuple(index - first for index in numbered)


def _long(
    draft: Draft, bodies: Entry, blocks: Mapping[str, list[tuple[Heading, Entry]]], scene: Scene, choices: Choices
) -> dict[str, tuple[Floats, Floats, tuple[int, ...]]]:
    """Return the quantities of a table with a row for each time and body; the draft gets the times."""
    ids = numbers(bodies.values)[0]
    if not np.all(ids == np.round(ids)):
        raise UsageError(f"column {bodies.heading!r} has numbers that are not whole; allowed: the number of a body")
    times, row = np.unique(draft.time, return_inverse=True)
    names, column = np.unique(ids.astype(np.int64), return_inverse=True)
    cell = row * len(names) + column
    if len(np.unique(cell)) != len(cell):
        twice = np.sort(cell)[np.flatnonzero(np.diff(np.sort(cell)) == 0)[0]]
        raise UsageError(
            f"body {names[twice % len(names)]} occurs twice at {times[twice // len(names)]:.9g} s; allowed: once at"
            " each time; write times with more digits"
        )
    where = np.full((len(times), len(names)), -1)
    where.flat[cell] = np.arange(len(cell))
    whole = np.all(where >= 0, axis=1)
    if not np.any(whole):
        raise UsageError("no time has all bodies of the file; allowed: the same bodies at every time")
    if not np.all(whole):
        lacking = names[where[~whole][0] < 0][0]
        draft.lost = (
            f"{np.sum(~whole)} of {len(times)} times lack a body and are not used: {times[~whole][0]:g} s lacks"
        )
        draft.lost += f" body {lacking}"
        draft.notes.append(draft.lost)
    rows = where[whole]
    draft.time, draft.time_rounding = times[whole], draft.time_rounding[rows[:, 0]]
    sampled = {}
    for quantity, block in blocks.items():
        heading, entry = block[0]
        values, rounding = numbers(entry.values)
        scale = choices.scale(quantity, heading.unit or entry.unit)
        from_one = bodies.heading.strip().lower() == "id"
        columns = _columns(draft, quantity, names.tolist(), scene, choices, from_one=from_one)
        sampled[quantity] = (*scaled(values[rows], rounding[rows], scale), columns)
    return sampled


def _add(draft: Draft, sampled: dict[str, tuple[Floats, Floats, tuple[int, ...]]], scene: Scene) -> None:
    """Add the quantities to the draft; columns without values are left out."""
    for name, (values, rounding, columns) in list(sampled.items()):
        absent = np.all(np.isnan(rounding), axis=0)
        if np.all(absent) or np.any(np.isnan(rounding[:, ~absent])):
            draft.notes.append(f"{name} is unknown, because the file has empty values")
            del sampled[name]
        elif np.any(absent):
            lacking = ", ".join(str(column) for column, empty in zip(columns, absent, strict=True) if empty)
            draft.notes.append(f"{name} of {'contact' if name == 'contact_force' else 'body'} {lacking} has no values")
            kept = tuple(column for column, empty in zip(columns, absent, strict=True) if not empty)
            sampled[name] = values[:, ~absent], rounding[:, ~absent], kept
    for name in QUANTITIES:
        if name in sampled:
            draft.add(name, *sampled[name])
    if "position" in sampled:
        draft.add_positions(*sampled["position"])
    if "contact_force" not in sampled and {"force_left", "force_right"} <= set(sampled):
        left, right = sampled["force_left"], sampled["force_right"]
        if left[2] == right[2] == tuple(range(scene.n_body)):
            forces, rounding = from_sides(left[0], right[0], scene), from_sides(left[1], right[1], scene)
            draft.add("contact_force", forces, rounding, range(scene.n_contact))


def from_sides(left: Floats, right: Floats, scene: Scene) -> Floats:
    """Return contact forces from the forces on the left and the right side of each body."""
    walls = [left[:, :1]] * (scene.wall_left is not None) + [right[:, -1:]] * (scene.wall_right is not None)
    return np.hstack([right[:, :-1], *walls])
