# The server with software OpenGL: raster renders without a GPU.
# The context is the repository: docker build -f docker/server.Dockerfile .
FROM debian:bookworm-slim AS base
RUN apt-get update \
 && apt-get install --yes --no-install-recommends ca-certificates python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/catoptra
WORKDIR /src
COPY constraints.txt ./

# The server's wheel with the native kernel: the compiler (411 MB) stays in this stage.
FROM base AS kernel
RUN /opt/catoptra/bin/pip install --no-cache-dir --constraint constraints.txt --upgrade \
      setuptools ziglang
# 0 on a platform without kernel: the image then traces with the reference.
ARG CATOPTRA_REQUIRE_KERNEL=1
COPY configs configs
COPY server server
RUN /opt/catoptra/bin/pip wheel --no-cache-dir --no-build-isolation --no-deps \
      --wheel-dir /wheels ./server

FROM base AS build
# Requirements first: they change less often than what is below, and are most of the image.
RUN /opt/catoptra/bin/pip install --no-cache-dir --constraint constraints.txt \
      matplotlib moderngl msgpack numpy opencv-contrib-python-headless \
      pillow pycollada pyzmq rich trimesh
COPY configs configs
COPY protocol protocol
# For `catoptra-studies figures`, which renders with the server's own code.
COPY client client
COPY studies studies
COPY --from=kernel /wheels /wheels
RUN /opt/catoptra/bin/pip install --no-cache-dir --constraint constraints.txt \
      ./protocol /wheels/*.whl ./client './studies[server]' \
 && /opt/catoptra/bin/pip uninstall --yes --quiet pip setuptools
# Files that are never loaded here: tests of libraries, sources and types of compiled modules, NumPy's
# Fortran and build tools, time zones besides Debian's, images that are no textures (AVIF), and the
# font subsetting of PDF output.
RUN cd /opt/catoptra/lib/python3*/site-packages \
 && find . -type d -name tests -prune -exec rm -r {} + \
 && find . -name '*.py[ix]' -delete -o -name '*.pxd' -delete -o -name '*.[ach]' -delete \
 && find pygments -type d -name __pycache__ -exec rm -r {} + \
 && rm -rf numpy/f2py numpy/distutils tzdata PIL/_avif.* pillow.libs/libavif-* \
 && cd fontTools && rm -r cu2qu feaLib pens qu2cu ttLib ufoLib varLib voltLib \
 && find . -name '*.so' -delete \
 && /opt/catoptra/bin/python -c 'import matplotlib.pyplot'

FROM debian:bookworm-slim AS system
# A base image may contain further packages: those without a dependant below are removed, at last the
# package manager and perl, and with them tables of character sets that Python has itself.
RUN apt-get update \
 && apt-get install --yes --no-install-recommends python3 libegl1 libgl1 libgl1-mesa-dri \
 && apt-mark auto $(apt-mark showmanual) > /dev/null && apt-mark manual python3 libegl1 libgl1 libgl1-mesa-dri > /dev/null \
 && apt-get autoremove --yes --purge -o APT::AutoRemove::RecommendsImportant=false \
      -o APT::AutoRemove::SuggestsImportant=false \
 && apt-get purge --yes --allow-remove-essential --auto-remove -o APT::AutoRemove::RecommendsImportant=false \
      -o APT::AutoRemove::SuggestsImportant=false apt perl-base \
 && rm -rf /usr/lib/*/gconv /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /usr/share/man /usr/share/locale \
 && find /usr/share/doc -type f ! -name copyright -delete
RUN useradd --uid 10001 --no-create-home --home-dir /nonexistent catoptra
COPY --from=build /opt/catoptra /opt/catoptra

# A root folder of its own: that of an imported base may be closed to ordinary users.
FROM scratch
COPY --from=system / /
# Drivers and matplotlib keep caches; the rest of the file system may be read-only.
ENV PATH=/opt/catoptra/bin:/usr/local/bin:/usr/bin:/bin PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    XDG_CACHE_HOME=/tmp/cache MPLCONFIGDIR=/tmp/matplotlib \
    OPENBLAS_NUM_THREADS=1
USER catoptra
EXPOSE 3000 5003 5005 5080
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=5s --timeout=3s --start-period=10s --retries=3 \
  CMD ["catoptra-server", "doctor", "--probe", "127.0.0.1"]
ENTRYPOINT ["catoptra-server"]
# All addresses of the container; the published ports decide which clients can connect.
CMD ["--robot", "p2at_omni", "--world", "four_legged_2006", "--host", "0.0.0.0"]
