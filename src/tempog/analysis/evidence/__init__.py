"""Places and objects from evidence per state, not per second: the method that does what the paper set out to do.

`states` says when each cell was occupied and when free, `grouping` puts cells together that change together,
`places` keeps the groups that behave like a leaf or a box rather than like people, `association` finds which places
are those of one thing, and `find` runs all of it.
"""
