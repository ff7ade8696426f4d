"""Decoding the messages of a connection into columns, many at a time."""

from ariac_score.logs.columnar.columns import Column, Columns, Defect
from ariac_score.logs.columnar.decode import ColumnDecoder
from ariac_score.logs.containers.items import Payloads

__all__ = ["Column", "ColumnDecoder", "Columns", "Defect", "Payloads"]
