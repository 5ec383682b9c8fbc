# docker build -t mavsight . && docker run --rm -v "$PWD:/data" mavsight run /data/session.toml --out /data/results
FROM rust:1.88-slim-bookworm AS build
WORKDIR /mavsight
COPY . .
RUN apt-get update && apt-get install -y --no-install-recommends build-essential \
    && cargo install --locked --path crates/mavsight --root /out

FROM debian:bookworm-slim
# Other formats than MP4 with H.264, network cameras and sound are read by ffmpeg.
RUN apt-get update && apt-get install -y --no-install-recommends ffmpeg && rm -rf /var/lib/apt/lists/*
COPY --from=build /out/bin/mavsight /usr/local/bin/mavsight
WORKDIR /data
ENTRYPOINT ["mavsight"]
