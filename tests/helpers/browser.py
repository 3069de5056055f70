"""Ask pages in Chromium, without a driver: a script is added to a page, and what it finds is read from the document."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

REQUIRED = os.environ.get("DEM_BRIDGE_REQUIRE_BROWSER") == "1"
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ROOT = Path(__file__).parents[2]
AXE = Path(os.environ.get("AXE_CORE", ROOT / "node_modules/axe-core/axe.min.js"))


def browse(*words: str) -> str:
    assert BROWSER is not None
    quiet = ("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync")
    given = (BROWSER, "--headless", "--no-sandbox", "--disable-gpu", *quiet, *words)
    return subprocess.run(given, capture_output=True, text=True, check=True, timeout=120).stdout


def asked(page: Path, folder: Path, script: str, *words: str, hash: str = "") -> Any:
    """What a script finds on the page once it is shown."""
    text = page.read_text(encoding="utf-8").replace(
        "</body>",
        f"<pre id=told></pre><script>told.textContent = JSON.stringify((() => {{{script}}})())</script></body>",
    )
    (folder / "asked.html").write_text(text, encoding="utf-8")
    address = (folder / "asked.html").as_uri() + hash
    shown = browse(f"--user-data-dir={folder / 'profile'}", *words, "--dump-dom", address)
    return json.loads(unescape(re.findall(r'<pre id="told">(.*?)</pre>', shown, re.DOTALL)[0]))


#: the rules of axe that are violated, once all is unfolded
_VIOLATED = """
for (const one of document.querySelectorAll("details")) one.open = true;
axe.run().then((found) => { told.textContent = JSON.stringify(found.violations.map((one) => one.id)); });
return ["axe has not answered"];
"""


def violations(page: Path, folder: Path, dark: bool = False) -> Any:
    text = page.read_text(encoding="utf-8")
    axe = AXE.read_text(encoding="utf-8").replace("</script", "<\\/script")
    with_axe = folder / "axe.html"
    with_axe.write_text(text.replace("</body>", f"<script>{axe}</script></body>"), encoding="utf-8")
    colours = f"--blink-settings=preferredColorScheme={0 if dark else 1}"
    return asked(with_axe, folder, _VIOLATED, colours, "--virtual-time-budget=60000")


needs_axe = pytest.mark.skipif(
    not AXE.is_file() and not REQUIRED, reason="no axe-core: npm install --no-save axe-core@4.14.1"
)
