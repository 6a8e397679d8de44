"""What a user did wrong, and what a user should know, each as one line."""

import warnings


class CospeechError(Exception):
    """A user's mistake: one line that names the file, the key and the remedy.

    The command line and the workflow's scripts print the line and exit with 2; anything else that is raised is our own
    defect and keeps its traceback.
    """


class CospeechNotice(UserWarning):
    """Something was unusual in the input, and the result is correct all the same."""


def notice(text):
    """Tell the user one line without stopping (shown on the terminal and in the rule's log)."""
    warnings.warn(text, CospeechNotice, stacklevel=2)
