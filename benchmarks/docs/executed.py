"""Runs the scripts of examples/ and the notebooks of examples/notebooks/, and writes a page of each.

A script or notebook that fails ends the run. One whose text and packages have not changed since its page was
written is not run again.
"""

import ast
import hashlib
import os
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT

EXAMPLES, NOTEBOOKS = ROOT / "examples", ROOT / "examples" / "notebooks"
PACKAGES = ("twin", "vision", "fe", "calibrate")
SECTION = """## {name}
{about}

```python
{code}
```

It prints:

```text
{printed}
```

"""
LAST = "This page is the output of `examples/notebooks/{}`. Jupyter opens it with jupytext.\n"


def surroundings() -> dict[str, str]:
    """The environment in which `python` and `twin` are those of this checkout."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}


def script_section(path: Path) -> str:
    """What a script shows, its code, and what it prints."""
    text = path.read_text(encoding="utf-8")
    about = ast.get_docstring(ast.parse(text)) or ""
    command = [sys.executable, path]
    done = subprocess.run(command, env=surroundings(), stdout=subprocess.PIPE, text=True, check=True)
    code = text.split('"""\n', 1)[-1].strip()
    return SECTION.format(name=path.stem, about=about, code=code, printed=done.stdout.rstrip())


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook after its run as Markdown, and its pictures by their names."""
    import jupytext
    from nbclient import NotebookClient

    notebook = jupytext.read(path)
    NotebookClient(notebook, kernel_name="python3", timeout=600).execute(env=surroundings())
    parts, pictures = [], {}
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        printed = "".join(output.text for output in cell.outputs if output.output_type == "stream")
        parts += [shown({"text/plain": printed})] if printed else []
        for k, data in enumerate(o.data for o in cell.outputs if o.output_type != "stream"):
            if "image/png" in data:
                name = f"{path.stem}-{number}-{k}.png"
                pictures[name] = b64decode(data["image/png"])
                parts.append(f"![Output]({name})")
            else:
                parts.append(shown(data))
    return "\n\n".join([*parts, LAST.format(path.name)]), pictures


def shown(data: Mapping[str, Any]) -> str:
    """An output of a cell: a table as HTML, anything else as text."""
    if "text/html" in data:
        table = re.search(r"<table.*</table>", data["text/html"], re.S)
        return re.sub(r"<(table|tr)[^>]*>", r"<\1>", table[0]) if table else ""
    return f"```text\n{data['text/plain'].rstrip()}\n```"


def digest(path: Path) -> str:
    """Of a script and of everything that it may use."""
    used = [path, Path(__file__), *(p for name in PACKAGES for p in sorted((ROOT / name).rglob("*.py")))]
    return hashlib.sha256(b"\0".join(p.read_bytes() for p in used)).hexdigest()


def page_of(path: Path, to: Path) -> None:
    """The page of a script or notebook, in `to`, with its pictures beside it; kept where nothing changed."""
    stamp = to.with_suffix(".digest")
    if stamp.is_file() and stamp.read_text() == digest(path):
        return
    page, pictures = notebook_page(path) if path.parent == NOTEBOOKS else (script_section(path), {})
    to.parent.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        (to.parent / name).write_bytes(picture)
    to.write_text(page, encoding="utf-8")
    stamp.write_text(digest(path))
    print(f"{path.relative_to(ROOT)}: run")
