"""Reports of runs and batches: one HTML page each, made from their files; it opens from disk without a network."""

from platoontraffic.report.batch_page import page as batch_page
from platoontraffic.report.comparison import page as comparison_page
from platoontraffic.report.page import page

__all__ = ["batch_page", "comparison_page", "page"]
