// A PCD cloud.

#include "acmp_mapping/dataset/map_io.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(pcd) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cloud.pcd", acmp::fuzz::Bytes(data, size).Rest());
  size_t not_finite = 0;
  acmp::fuzz::MayRefuse([&] { acmp::ReadPcd(path, &not_finite); });
  return 0;
}
