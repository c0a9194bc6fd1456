"""Log of the server on standard error, which no client and no unread pipe can block or flood.

`log_formatter` escapes texts, `line_limiter` counts repeated lines, `log_writer` writes in a thread
of its own.
"""
