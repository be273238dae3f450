"""A run as one HTML page to read, with pictures that are files as well."""

from platoontraffic.report.page import page

__all__ = ["page"]
