"""A backend for tests that fly nothing: it does the work in this process, at once."""

from concurrent.futures import Future

from heli_twin.workers.engine import Trouble


class InProcess:
    """Made like any other backend, from a plan and a timeout that do not matter."""

    def __init__(self, *ignored):
        pass

    def workers(self):
        return 1

    def submit(self, work, task):
        future = Future()
        try:
            future.set_result(work(task))
        except Exception as error:
            future.set_exception(error)
        return future

    def trouble(self, error):
        return Trouble("error", str(error))

    def __enter__(self):
        return self

    def __exit__(self, *stopped):
        pass
