// A PCD cloud, as acmp_evaluate reads it.

#include <sstream>

#include "cloud_file.h"
#include "fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cloud.pcd", acmp::fuzz::Bytes(data, size).Rest());
  std::ostringstream notes;
  acmp::fuzz::MayRefuse([&] { acmp::ReadCloudFile(path, &notes); });
  return 0;
}
