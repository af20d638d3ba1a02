# docker build -t artitwin .
# docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" artitwin reconstruct bags/drawer --out runs
# docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" --network host artitwin node
FROM rust:1.95-bookworm AS build
WORKDIR /source
COPY . .
RUN cargo build --release --locked && .ci/licenses >LICENSE-THIRD-PARTY

FROM debian:bookworm-slim
COPY --from=build /source/target/release/artitwin /usr/local/bin/
COPY --from=build /source/LICENSE-APACHE /source/LICENSE-MIT /source/LICENSE-THIRD-PARTY /usr/share/doc/artitwin/
RUN useradd --create-home artitwin
USER artitwin
WORKDIR /work
ENTRYPOINT ["artitwin"]
