"""The command `hil` of an installed wheel: replaces this process with the program."""

import os
import sys


def main() -> None:
    """Executes the program `hil` with the arguments of this process."""
    from .errors import ProgramError
    from .programs import cannot_start, environment, find

    try:
        program = find()
        try:
            # Standard output of Python holds nothing yet that could be lost.
            os.execve(program, [program, *sys.argv[1:]], environment())
        except OSError as error:
            raise cannot_start(program, error) from error
    except ProgramError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(3) from None


if __name__ == "__main__":
    main()
