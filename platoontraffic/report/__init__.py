"""A run, or a batch, as one HTML page to read: made from its files, opened from disk, without a network."""

from platoontraffic.report.batch_page import page as batch_page
from platoontraffic.report.page import page

__all__ = ["batch_page", "page"]
