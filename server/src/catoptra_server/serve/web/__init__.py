"""The live page: files, a description of the server, and WebSockets.

`web_server` has the port and its connections, `web_access` decides who may use the page, `pages`
has all that is read by GET. A `page_socket` is a client of the stream, like one on ZeroMQ.

No framework, no bundler, no library in the page: ES modules, WebGL2 in a worker (without a graphics
processor a context takes up to 2 s to make) and a 2D canvas for the rest, 255 kB of readable files
that any browser of the last years loads unchanged. uPlot was in the page first: 53 kB for what 5 kB
draw here.
"""

from __future__ import annotations
