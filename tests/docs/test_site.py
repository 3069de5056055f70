"""The build of the site fails where a page, a public name or an equation is missing, or a page needs the network.

``make docs`` builds the whole site with these checks; here faults are planted in a site of one page.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytest.importorskip("sphinx", reason="the extra docs is not installed")

SETTINGS = f"""
import sys
sys.path.insert(0, {str(ROOT / "docs" / "_ext")!r})
extensions = ["myst_parser", "sphinx.ext.autodoc", "accessible", "mathml", "site_checks"]
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
html_theme = "basic"
public_package = "small"
"""
INDEX = """# Site

$$\\frac{1}{2} m v^2$$

[a link](https://doi.org/10.1098/rsta.2017.0136)

```text
code
```

```{eval-rst}
.. autofunction:: small.one
```
"""
PACKAGE = '__all__ = ["one"]\n\ndef one():\n    """Return one."""\n    return 1\n'
GOOD = {"conf.py": SETTINGS, "index.md": INDEX, "small.py": PACKAGE}


def build(folder: Path, files: dict[str, str]) -> tuple[int, str]:
    """Build a site as ``make docs`` does, and return the exit code and the messages."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    words = [sys.executable, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-q", str(folder), str(folder / "out")]
    environment = {**os.environ, "PYTHONPATH": str(folder), "NO_COLOR": "1"}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    return done.returncode, done.stderr


def test_a_site_without_faults_is_built_with_mathml(tmp_path: Path) -> None:
    assert build(tmp_path, GOOD) == (0, "")
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "<mfrac>" in page
    assert 'id="small.one"' in page
    assert page.count('<pre tabindex="0">') == 1  # the keyboard can scroll it


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("small.py", PACKAGE.replace('"one"]', '"one", "two"]'), "the API reference has no entry for small.two"),
        ("lost.md", "# Lost\n", "lost.md: WARNING: document isn't included in any toctree"),
        ("index.md", INDEX.replace(r"\frac", r"\fraction"), "a command of this equation is unknown: \\fraction"),
        ("index.md", INDEX + "\n![map](https://example.org/map.png)\n", "index.html loads a file from the network"),
        ("index.md", INDEX + "\n[glossary](glossary.md)\n", "WARNING: 'myst' cross-reference target not found"),
    ],
    ids=["public name", "toctree", "equation", "network", "link"],
)
def test_a_planted_fault_fails_the_build(tmp_path: Path, name: str, text: str, message: str) -> None:
    code, messages = build(tmp_path, {**GOOD, name: text})
    assert code != 0
    assert message in messages


def test_ci_builds_the_site_and_warnings_are_errors() -> None:
    assert "make docs\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    [line] = [line for line in (ROOT / "Makefile").read_text(encoding="utf-8").splitlines() if "-m sphinx" in line]
    assert " -W " in line
    settings = (ROOT / "docs" / "conf.py").read_text(encoding="utf-8")
    extensions = settings.partition("extensions = [")[2].partition("]")[0]
    assert {"accessible", "mathml", "site_checks"} <= set(re.findall(r'"(\w+)"', extensions))
    assert 'public_package = "dem_bridge"' in settings
