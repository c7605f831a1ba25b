"""`python -m palpate.render.cli` is the command `palpate`."""

from .app import main

main()
