"""Decoding the messages of a connection into columns, all at once."""

from ariac_score.logs.columnar.columns import Column, Columns, Defect, Payloads
from ariac_score.logs.columnar.decode import ColumnDecoder

__all__ = ["Column", "ColumnDecoder", "Columns", "Defect", "Payloads"]
