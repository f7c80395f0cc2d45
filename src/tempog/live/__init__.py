"""Robots that drive now: their messages in, a map that grows and what happens in it out."""
