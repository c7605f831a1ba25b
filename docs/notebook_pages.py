"""Runs a notebook and makes a page of the site of it: text, code, and what the code shows."""

import base64
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from traitlets.config import Config

TIME_MOST = 300  # of a cell [s]


def run(path: Path) -> dict[str, str | bytes]:
    """The page and its pictures, by file name.

    The notebook runs in a folder of its own. Raises nbclient's CellExecutionError where a cell fails.
    """
    book = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        sockets = {
            "transport": "ipc",
            "ip": f"{folder}/kernel",
        }  # files in the folder: no port is open
        settings = Config({"KernelManager": sockets})
        NotebookClient(
            book,
            config=settings,
            timeout=TIME_MOST,
            resources={"metadata": {"path": folder}},
        ).execute()
    files: dict[str, str | bytes] = {}
    parts = []
    for cell in book.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                name = f"{path.stem}-{len(files) + 1}.png"
                files[name] = base64.b64decode(data["image/png"])
                parts.append(f"![What the cell above draws]({name})")
            elif text := data.get("text/plain", "").rstrip():
                parts.append(f"```text\n{text}\n```")
    parts.append(f"[This page as a notebook]({path.name})")
    return {f"{path.stem}.md": "\n\n".join(parts) + "\n", **files}
