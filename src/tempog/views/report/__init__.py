"""A page about a map that needs nothing but itself."""

from tempog.views.report.page import report_page

__all__ = ["report_page"]
