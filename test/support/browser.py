# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium to look at a page with, offline."""

from __future__ import annotations

from html import unescape
import json
from pathlib import Path
import re
import subprocess
from typing import Any, NamedTuple

from patience import PATIENCE

__all__ = ['Browser', 'Visit']

PROBE = """
<script>
addEventListener('error', (event) => { document.body.dataset.error = event.message; });
(async () => {
  while (!document.body.dataset.drawn) await new Promise((done) => setTimeout(done, 20));
  const result = await (async () => { %s })();
  document.body.dataset.result = JSON.stringify(result === undefined ? null : result);
})().catch((error) => { document.body.dataset.error = String(error); });
</script>
"""


class Visit(NamedTuple):
    """What a browser made of a page: what the probe returned, console lines, final HTML."""

    result: Any
    console: list[str]
    html: str


class Browser:
    """Opens pages one after the other with a profile of its own."""

    def __init__(self, program: str, folder: Path) -> None:
        """Take the program and a folder for its profile and the copies of the pages."""
        self._program, self._folder = program, folder

    def visit(self, page: Path, script: str) -> Visit:
        """Open a page, run ``script`` in it once it is drawn, and return what came of it."""
        copy = self._folder / 'page.html'
        copy.write_text(page.read_text(encoding='utf-8').replace(
            '</body>', PROBE % script + '</body>'), encoding='utf-8')
        done = subprocess.run(
            [self._program, '--headless', '--no-sandbox', '--disable-gpu',
             '--disable-dev-shm-usage', '--enable-unsafe-swiftshader', '--window-size=1280,900',
             f'--user-data-dir={self._folder / "profile"}', '--enable-logging=stderr',
             # Offline: every host name leads nowhere.
             '--host-resolver-rules=MAP * ~NOTFOUND', '--virtual-time-budget=60000',
             '--dump-dom', copy.as_uri()],
            capture_output=True, timeout=PATIENCE, check=True)
        html = done.stdout.decode()
        console = [line for line in done.stderr.decode(errors='replace').splitlines()
                   if 'CONSOLE' in line]
        problem = re.search(r'<body[^>]* data-error="([^"]*)"', html)
        assert problem is None, unescape(problem[1])
        found = re.search(r'<body[^>]* data-result="([^"]*)"', html)
        assert found is not None, 'the probe did not finish'
        return Visit(json.loads(unescape(found[1])), console, html)
