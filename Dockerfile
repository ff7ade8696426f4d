# The scorer of a hosted competition: no network, no root, nothing written but /app/output and /tmp.
#   docker build -t ariac-score .
#   docker run --rm --read-only --tmpfs /tmp --network none -v "$PWD/input:/app/input:ro" \
#     -v "$PWD/output:/app/output" ariac-score ariac-score platform codabench score /app/input /app/output
# There is no ENTRYPOINT: a platform gives the whole command, which would become the arguments of one.
FROM python:3.12-slim AS build
WORKDIR /src
COPY . .
RUN python -m venv /opt/ariac-score && \
    /opt/ariac-score/bin/pip install --no-cache-dir --no-deps --require-hashes -r .ci/container.txt && \
    /opt/ariac-score/bin/pip install --no-cache-dir --no-deps --no-build-isolation . && \
    /opt/ariac-score/bin/pip uninstall --yes setuptools

FROM python:3.12-slim
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin scorer
COPY --from=build /opt/ariac-score /opt/ariac-score
ENV PATH=/opt/ariac-score/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    XDG_CACHE_HOME=/tmp
WORKDIR /app
USER 10001
CMD ["ariac-score", "--help"]
