"""A page about a map that needs nothing but itself; see `tempog.views.report.page`."""
