# The node and the command `lava` beside ROS 2 Jazzy:
#     docker build -t lava_ros . && docker run --rm lava_ros demo --help
# With a GPU: --gpus all. In the graph of the host: --network host --ipc host. Bags that stay:
# -v "$PWD/bags:/data/bags". Compiled kernels that stay: -v lava_cache:/cache
FROM ros:jazzy-ros-base
RUN apt-get update \
 && apt-get install --yes --no-install-recommends python3-venv ros-jazzy-grid-map-msgs \
 && rm -rf /var/lib/apt/lists/*
COPY . /src
# ROS is the image's, and so is the numpy that its messages were compiled with.
RUN python3 -m venv --system-site-packages /opt/lava \
 && /opt/lava/bin/pip install --no-cache-dir --constraint /src/constraints-jazzy.txt '/src[gis,view,cluster]' \
 && rm -rf /src
ENV AMENT_PREFIX_PATH=/opt/lava PATH=/opt/lava/bin:$PATH WARP_CACHE_PATH=/cache
WORKDIR /data
ENTRYPOINT ["/ros_entrypoint.sh", "lava"]
CMD ["--help"]
