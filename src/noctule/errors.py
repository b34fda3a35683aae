"""The root of every error that Noctule raises on purpose.

Each cause has a class of its own, defined in the room that raises it. A message is one line that says what
was wrong, what was found, what was expected and what to do; the command line prints it as it is.
"""


class NoctuleError(Exception):
    """Something that the person at the keyboard can mend; the message says how."""
