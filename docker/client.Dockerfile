# The client library and the studies that need no server here: no OpenGL, nothing of the server.
# The context is the repository: docker build -f docker/client.Dockerfile .
FROM debian:bookworm-slim AS build
RUN apt-get update \
 && apt-get install --yes --no-install-recommends ca-certificates python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/catoptra
WORKDIR /src
COPY constraints.txt ./
RUN /opt/catoptra/bin/pip install --no-cache-dir --constraint constraints.txt \
      matplotlib msgpack numpy opencv-contrib-python-headless pyzmq rich
COPY configs configs
COPY protocol protocol
COPY client client
COPY studies studies
# Without the extra [server]: the paper's experiment reaches its servers by address.
RUN /opt/catoptra/bin/pip install --no-cache-dir --constraint constraints.txt \
      ./protocol ./client ./studies \
 && /opt/catoptra/bin/pip uninstall --yes --quiet pip setuptools
# Never loaded here: the tests of libraries, and matplotlib's subsetting of fonts for PDF.
RUN cd /opt/catoptra/lib/python3*/site-packages \
 && find . -type d -name tests -prune -exec rm -r {} + \
 && find pygments -type d -name __pycache__ -exec rm -r {} + \
 && cd fontTools && rm -r cu2qu feaLib pens qu2cu ttLib ufoLib varLib voltLib \
 && find . -name '*.so' -delete \
 && /opt/catoptra/bin/python -c 'import matplotlib.pyplot'

FROM debian:bookworm-slim AS system
# A base may bring more than is needed here: packages on which nothing below depends are removed.
RUN apt-get update \
 && apt-get install --yes --no-install-recommends python3 \
 && apt-mark auto $(apt-mark showmanual) > /dev/null && apt-mark manual python3 > /dev/null \
 && apt-get autoremove --yes --purge -o APT::AutoRemove::RecommendsImportant=false \
      -o APT::AutoRemove::SuggestsImportant=false \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /usr/share/man /usr/share/locale \
 && find /usr/share/doc -type f ! -name copyright -delete
RUN useradd --uid 10001 --no-create-home --home-dir /nonexistent catoptra
COPY --from=build /opt/catoptra /opt/catoptra

# A root folder of its own: that of an imported base may be closed to ordinary users.
FROM scratch
COPY --from=system / /
ENV PATH=/opt/catoptra/bin:/usr/local/bin:/usr/bin:/bin PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    MPLCONFIGDIR=/tmp/matplotlib OPENBLAS_NUM_THREADS=1
# The proof: client and experiment load, and there is no OpenGL and no server for them to load.
RUN ! /sbin/ldconfig -p | grep -E 'lib(GL|EGL|OSMesa)' \
 && python3 -c "import catoptra_client.__main__, catoptra_studies.experiment.demo_command" \
 && python3 -c "import importlib.util as u, sys; sys.exit(any(map(u.find_spec, \
      ['catoptra_server', 'moderngl', 'glcontext', 'OpenGL'])))"
USER catoptra
ENTRYPOINT ["catoptra-client"]
CMD ["--help"]
