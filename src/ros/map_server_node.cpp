#include "standalone_node.h"

int main(int argc, char** argv) {
  return acmp::RunStandalone(argc, argv, "map_server", "acmp_mapping/MapServerNodelet");
}
