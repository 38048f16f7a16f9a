import os
import signal

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before anything imports numpy or torch

# A shell's background job has ^C ignored, and hands that down to the processes that the tests stop by it.
signal.signal(signal.SIGINT, signal.default_int_handler)
