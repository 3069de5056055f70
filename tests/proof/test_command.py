"""`dem-bridge prove`: what is proved, the certificate, and what is refused in one line."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from dem_bridge.errors import BackendUnavailable
from dem_bridge.proof import balls
from dem_bridge.proof.certificate import digest_of
from tests.helpers import processes
from tests.helpers.command_line import assert_one_line, run_here

pytest.importorskip("flint")

PAIR = """name = "pair"
duration = 1e-4
[chain]
mass = [8e-3, 1e-2]
stiffness = [4e9]
velocity = [0.8, 0.0]
gap = [1e-6]
[sampling]
count = 5
"""


def test_a_scene_is_proved_and_its_certificate_written(tmp_path: Path) -> None:
    (tmp_path / "pair.toml").write_text(PAIR)
    done = run_here("prove", "pair.toml", "-o", "pair.json", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.splitlines()[0] == "pair: proved up to 0.0001 s"
    assert "6 samples, 2 touches" in done.stdout
    assert "peak forces of 1 of 1 contacts, radius at most" in done.stdout
    assert "crossing times of 1 of 1 contacts, radius at most" in done.stdout
    document = json.loads((tmp_path / "pair.json").read_text())
    assert document["schema"] == "dem-bridge/proof/1"
    done = run_here("prove", "pair.toml", "--check", "pair.json", "-j", "1", cwd=tmp_path)
    assert (done.returncode, "2 touches" in done.stdout) == (0, True)
    done = run_here("prove", "pair.toml", "-o", "pair.json", "--json", cwd=tmp_path)
    printed = json.loads(done.stdout)
    (force, radius), (time, _) = printed["peak_force"][0], printed["crossing_time"][0]
    assert (printed["complete"], len(printed["touches"])) == (True, 2)
    assert 0.0 < radius < 1e-15 * force
    # the contact is symmetric in time
    assert time == pytest.approx(sum(touch["time"][0] for touch in printed["touches"]) / 2, rel=1e-14)
    done = run_here("prove", "--check", "pair.json", "-j", "1", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["proved"] is True
    document["touches"].pop()
    (tmp_path / "forged.json").write_text(json.dumps({**document, "digest": digest_of(document)}))
    done = run_here("prove", "--check", "forged.json", "-j", "1", cwd=tmp_path)
    assert (done.returncode, "not proved" in done.stdout) == (1, True)
    assert_one_line(
        run_here("prove", "--check", "none.json", cwd=tmp_path), "none.json: the certificate cannot be read"
    )
    done = run_here("prove", "pair.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "Missing SCENE and '-o FILE', or '--check FILE'." in done.stderr


def test_what_cannot_be_proved_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "drag.toml").write_text(f"{PAIR}[environment]\ndrag = 1.0\n")
    done = run_here("prove", "drag.toml", "-o", "pair.json", cwd=tmp_path)
    assert_one_line(done, "pair cannot be proved: the scene has drag; supported: walls, gaps")
    done = run_here("prove", "drag.toml", "-o", "pair.json", "--digits", "0", cwd=tmp_path)
    assert_one_line(done, "--digits = 0; allowed: a whole number from 1 to 60")


def test_processes_of_a_check_end_with_it(tmp_path: Path) -> None:
    file = Path(__file__).parents[2] / "reports" / "proofs" / "chain-10-7.json"  # takes a second and more a segment
    command = [sys.executable, "-m", "dem_bridge", "prove", "--check", str(file), "-j", "2"]
    check = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    listed = Path(f"/proc/{check.pid}/task/{check.pid}/children")
    # the third looks after what they share
    assert processes.happens(lambda: check.poll() is not None or len(listed.read_text().split()) == 3)
    began = [int(word) for word in listed.read_text().split()]
    processes.pause(1.0)
    assert check.poll() is None, "the check ended before it was killed"
    check.kill()
    check.wait()
    assert processes.all_end(began, within=60.0)


def test_without_the_library_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flint", None)
    balls.library.cache_clear()
    with pytest.raises(BackendUnavailable, match="needs python-flint, which is not installed; install the extra"):
        balls.library()
    monkeypatch.undo()
    assert balls.library()
