"""The Python that Debian's ROS 1 packages belong to, where they are installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

SYSTEM_PYTHON = "/usr/bin/python3"
HERE = Path(__file__).parent


@cache
def has(*modules: str) -> bool:
    """Whether that Python has some modules."""
    asked = [SYSTEM_PYTHON, "-c", "import " + ", ".join(modules)]
    return bool(shutil.which(SYSTEM_PYTHON)) and subprocess.run(asked, capture_output=True).returncode == 0


def ask(script: str, question: Any) -> Any:
    """The answer of a script in this folder, run by that Python, to a question; both as JSON."""
    run = subprocess.run(
        [SYSTEM_PYTHON, str(HERE / script)],
        input=json.dumps(question),
        capture_output=True,
        text=True,
        env={"LC_ALL": "C.UTF-8"},
        check=True,
    )
    return json.loads(run.stdout)
