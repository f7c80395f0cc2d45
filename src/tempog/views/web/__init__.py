"""The viewer's server: tiles of the picture and answers about a map, over HTTP. Needs the extra ``view``."""
