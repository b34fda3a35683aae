"""`python -m noctule`: the same as the `noctule` command, from a checkout that was moved too."""

from noctule.cli import main

main()
