"""What is raised where a command is not admitted."""


class NotAdmitted(Exception):
    """A command that is not admitted. code: in dehyst.daemon.bus.refusal_codes.CODES; the text is
    for the client."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code
