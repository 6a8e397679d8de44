"""Work ahead: an iterator that runs in a thread of its own, a bounded number of items before its consumer."""

import queue
import threading
from collections.abc import Iterator

END = object()


def prefetch(items, size) -> Iterator:
    """Yield what `items` yields while a thread computes up to `size` items in advance; its exceptions arrive here.

    The thread ends soon after the consumer stops asking (closes the generator or drops it).
    """
    waiting, stopped = queue.Queue(maxsize=size), threading.Event()

    def put(item):
        while not stopped.is_set():
            try:
                waiting.put(item, timeout=0.1)
                return
            except queue.Full:
                continue

    def work():
        try:
            for item in items:
                put((item, None))
                if stopped.is_set():
                    return
            put((END, None))
        except BaseException as error:  # whatever it is, the consumer's thread raises it
            put((END, error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is END:
                return
            yield item
    finally:
        stopped.set()
        thread.join()
