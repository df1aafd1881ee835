"""Studies that maintainers run: where fitted numbers come from, and evidence behind claims.

They need a checkout of the repository and are not part of the installed package. `README.md` in
this folder lists them; each runs as `python -m research.NAME`.
"""
