"""Notebooks as pages: each ``notebooks/NAME.ipynb`` becomes ``notebooks/NAME.md`` while building.

What the pages show is what the notebooks hold; a test runs them afresh.
"""

from pathlib import PurePosixPath
from typing import Any

from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter

__all__ = ["on_files"]


def on_files(files: Files, config: Any) -> Files:
    """Add a page and its pictures for every notebook among the files."""
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        place = PurePosixPath(notebook.src_uri)
        body, resources = MarkdownExporter().from_filename(str(notebook.abs_src_path))
        for name, picture in resources["outputs"].items():
            named = f"{place.stem}_{name}"
            body = body.replace(f"({name})", f"({named})")
            files.append(File.generated(config, str(place.with_name(named)), content=picture))
        link = f"[Download this notebook]({place.name})\n"
        page = str(place.with_suffix(".md"))
        files.append(File.generated(config, page, content=f"{body}\n{link}"))
    return files
