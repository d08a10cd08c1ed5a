"""The cells of a table in a text area, shown as a sheet that can be edited."""

from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from pipelines.app.words import Say

__all__ = ["cells_of", "show_cells"]

_SEPARATORS = "\t;,"


def cells_of(text: str) -> list[list[str]]:
    """Rows of cells, the first the headings, each as long as these.

    Parameters
    ----------
    text : str
        Lines of cells between tabs, semicolons or commas, whichever the headings hold most.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        return []
    separator = max(_SEPARATORS, key=lines[0].count)
    rows = [line.split(separator) for line in lines]
    wide = len(rows[0])
    return [[cell.strip() for cell in (row + [""] * wide)[:wide]] for row in rows]


def show_cells(area: ui.textarea, say: Say) -> None:
    """Show the table of a text area as a sheet; what is changed in one changes in the other."""
    grid = ui.aggrid(_options(cells_of(str(area.value or ""))), auto_size_columns=False)
    grid.classes("w-full").props(f'data-test=cells role=group aria-label="{say("cells")}"')

    def follow() -> None:
        grid.options.update(_options(cells_of(str(area.value or ""))))
        grid.update()

    def edited(event: GenericEventArguments) -> None:
        rows = cells_of(str(area.value or ""))
        row, column = int(event.args["rowIndex"]) + 1, int(str(event.args["colId"])[1:])
        if row < len(rows) and column < len(rows[0]):
            cell = event.args.get("newValue")
            rows[row][column] = " ".join(str("" if cell is None else cell).split())
            area.value = "\n".join("\t".join(one) for one in rows)

    area.on_value_change(follow)
    grid.on("cellValueChanged", edited, args=["rowIndex", "colId", "newValue"])


def _options(rows: list[list[str]]) -> dict[str, Any]:
    names = rows[0] if rows else []
    return {
        "columnDefs": [
            {
                "headerName": name,
                "field": f"c{place}",
                "editable": True,
                "sortable": False,
                "flex": 1,
                "minWidth": 120,
            }
            for place, name in enumerate(names)
        ],
        "rowData": [{f"c{place}": cell for place, cell in enumerate(row)} for row in rows[1:]],
        "stopEditingWhenCellsLoseFocus": True,
        "domLayout": "autoHeight" if len(rows) < 12 else "normal",
    }
