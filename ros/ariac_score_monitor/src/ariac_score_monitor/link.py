"""The connection to the oracle, made again whenever it is lost, in a thread of its own."""

import threading

from ariac_score_monitor.websocket import Connection, LostError

__all__ = ["Link"]


class Link(object):
    """Whoever asks never waits for an oracle that is not there.

    Args:
        plan: Whom to ask.
        note: Takes what happens, as a word and its fields.
    """

    def __init__(self, plan, note):
        self._plan, self._note = plan, note
        self._connection = None
        self._needed, self._ending = threading.Event(), threading.Event()
        self._needed.set()
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()

    @property
    def is_there(self):
        """Whether somebody can be asked."""
        return self._connection is not None

    def ask(self, text):
        """The answer to a message.

        Raises:
            LostError: There is none.
        """
        connection = self._connection
        if connection is None:
            raise LostError("there is no oracle")
        try:
            return connection.ask(text)
        except LostError as cause:
            self._connection = None
            self._note("lost", why=str(cause))
            self._needed.set()
            raise

    def wait(self, limit_s):
        """Wait until somebody can be asked; whether that came."""
        for _ in range(max(1, int(limit_s / 0.02))):
            if self.is_there or self._ending.wait(0.02):
                break
        return self.is_there

    def end(self):
        """Connect no more."""
        self._ending.set()
        self._needed.set()
        self._thread.join(2 * self._plan.timeout_s)
        if self._connection is not None:
            self._connection.close()

    def _keep(self):
        said = ""
        while True:
            self._needed.wait()
            if self._ending.is_set():
                return
            plan = self._plan
            try:
                connection = Connection(plan.host, plan.port, plan.name, plan.token, plan.timeout_s)
            except LostError as cause:
                if str(cause) != said:
                    said = str(cause)
                    self._note("no_oracle", why=said)
                self._ending.wait(plan.retry_s)
                continue
            said = ""
            self._needed.clear()
            self._connection = connection
            self._note("connected")
