# The program alone on a small system, for an ordinary user:
#   docker build --build-arg COMMIT=$(git rev-parse --short=12 HEAD) -t dsfms .
#   docker run --rm -u $(id -u):$(id -g) -v "$PWD":/data dsfms demo
FROM rust:1.95-slim-trixie AS build
WORKDIR /source
COPY . .
ARG COMMIT=
# x86-64-v3 (AVX2, FMA) as in .cargo/config.toml; x86-64 for any CPU, SIFT and the solver two to three
# times slower.
ARG CPU=x86-64-v3
RUN DSFMS_BUILD_COMMIT="$COMMIT" RUSTFLAGS="-C target-cpu=$CPU" \
    cargo build --release --locked -p dsfms-cli

FROM debian:trixie-slim
# ffmpeg reads the videos that are no H.264 mp4, and writes overlay.mp4.
RUN apt-get update && apt-get install -y --no-install-recommends ffmpeg \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /source/target/release/dsfms /usr/local/bin/dsfms
COPY --from=build /source/LICENSE-MIT /source/LICENSE-APACHE /source/crates/dsfms-cli/data/font/OFL.txt \
    /source/crates/dsfms-cli/assets/three.LICENSE /source/crates/dsfms/data/organs/README.md /usr/share/doc/dsfms/
RUN useradd --create-home dsfms
USER dsfms
WORKDIR /data
ENTRYPOINT ["dsfms"]
