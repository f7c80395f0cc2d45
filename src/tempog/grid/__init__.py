"""Every cell's whole history."""
