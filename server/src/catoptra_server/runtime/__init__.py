"""What a long-running server needs, whatever it serves: memory, queues, faults, logs, options."""
