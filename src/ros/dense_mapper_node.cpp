#include "standalone_node.h"

int main(int argc, char** argv) {
  return acmp::RunStandalone(argc, argv, "dense_mapper", "acmp_mapping/DenseMapperNodelet");
}
