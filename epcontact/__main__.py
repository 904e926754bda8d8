"""`python -m epcontact`: the command line."""

from epcontact.cli import main

if __name__ == "__main__":
    main()
