"""Truth to compare with: layouts of the published datasets, their sequence lists and figures."""

from zsmoseg.datasets.layouts import Dataset, open_dataset
from zsmoseg.datasets.selection import Selection, select
from zsmoseg.datasets.sequence import Points, Truth

__all__ = ["Dataset", "Points", "Selection", "Truth", "open_dataset", "select"]
