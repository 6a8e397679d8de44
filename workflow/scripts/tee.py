"""What a job says, in its log and on the terminal."""

import warnings


class Tee:
    """Text goes to log and terminal, but progress bars (they start with a carriage return) only to a terminal."""

    def __init__(self, log, terminal):
        self.log, self.terminal = log, terminal

    def write(self, text):
        progress = text.startswith("\r")
        if not progress:
            self.log.write(text)
        if not progress or self.terminal.isatty():
            self.terminal.write(text)
        return len(text)

    def flush(self):
        self.log.flush()
        self.terminal.flush()

    def isatty(self):
        return self.terminal.isatty()


def warnings_to(tee, label, shown):
    """For `warnings.showwarning`: the category `shown` as one line for the user, others into the log alone."""

    def show(message, category, filename, line, *_):
        if issubclass(category, shown):
            print(f"{label}: note: {message}", file=tee)
        else:
            tee.log.write(warnings.formatwarning(message, category, filename, line))

    return show
