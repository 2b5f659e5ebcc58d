// A PLY cloud.

#include "acmp_mapping/dataset/map_io.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(ply) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cloud.ply", acmp::fuzz::Bytes(data, size).Rest());
  acmp::fuzz::MayRefuse([&] { acmp::ReadPly(path); });
  return 0;
}
