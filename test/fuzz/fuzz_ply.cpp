// A PLY cloud.

#include "acmp_mapping/dataset/map_io.h"
#include "fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cloud.ply", acmp::fuzz::Bytes(data, size).Rest());
  acmp::fuzz::MayRefuse([&] { acmp::ReadPly(path); });
  return 0;
}
