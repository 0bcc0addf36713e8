"""What all pictures have in common: how their axes look, and what is written of them."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure


def finish(axes: Axes, label: str) -> None:
    """Give them a label, a grid and room; a legend beside them where lines have names."""
    axes.set_ylabel(label, fontsize=9)
    axes.grid(axis="y", color="#eceff1", lw=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=8)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.02),
            fontsize=8,
            frameon=False,
            handlelength=1.2,
        )


def png(figure: Figure) -> bytes:
    """Return what is written to a file."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()
