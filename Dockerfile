# The README's two commands on a bare Debian, on the CPU: docker build [--build-arg RELEASE=bullseye|bookworm|trixie] .
# scripts/test_on.sh does the same without Docker.
ARG RELEASE=bookworm
FROM debian:${RELEASE}
ENV LC_ALL=C.UTF-8
COPY . /acmp_mapping
WORKDIR /acmp_mapping
RUN scripts/demo.sh
RUN scripts/test.sh
