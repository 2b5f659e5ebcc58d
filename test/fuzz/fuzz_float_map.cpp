// PFM and DMB files.

#include "acmp_mapping/dataset/map_io.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(float_map) {
  using namespace acmp;
  static const fuzz::Folder folder;
  const std::string_view content = fuzz::Bytes(data, size).Rest();
  const auto pfm = folder.Write("map.pfm", content);
  const auto dmb = folder.Write("map.dmb", content);
  fuzz::MayRefuse([&] { ReadDepth(pfm); });
  fuzz::MayRefuse([&] { ReadPfmNormals(pfm); });
  fuzz::MayRefuse([&] { ReadDepth(dmb); });
  return 0;
}
