"""An executor of units without a process."""

from concurrent.futures import Future


class AtOnce:
    """Makes each call at once, in this thread."""

    workers = 1
    closed = False

    def shared(self, value):
        return lambda: value

    def prepare(self, function, *arguments):
        return self.submit(function, *arguments, priority=0)

    def submit(self, function, *arguments, priority):
        future = Future()
        try:
            future.set_result(self.called(function, *arguments))
        except Exception as error:  # noqa: BLE001 - as an executor does
            future.set_exception(error)
        return future

    def called(self, function, *arguments):
        return function(*arguments)
