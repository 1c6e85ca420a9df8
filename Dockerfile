# SPDX-License-Identifier: Apache-2.0
# The workspace on a bare Debian 12, by the same steps as on a machine (tools/setup.sh); see docs/user/install.md.
FROM debian:12
RUN apt-get update -q && apt-get install -y -q --no-install-recommends ca-certificates git make sudo
WORKDIR /fcsv
COPY . .
RUN tools/setup.sh && rm -rf /var/lib/apt/lists/*
ENTRYPOINT ["bash", "-c", ". /fcsv/devel/setup.sh && exec \"$@\"", "fcsv"]
CMD ["make", "demo"]
