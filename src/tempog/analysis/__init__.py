"""Questions asked of the history. Every analysis takes a grid, a saved map, or a window of either."""
