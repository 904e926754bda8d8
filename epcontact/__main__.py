"""`python -m epcontact`: the command line."""

from epcontact.cli.main import main

if __name__ == "__main__":
    main()
