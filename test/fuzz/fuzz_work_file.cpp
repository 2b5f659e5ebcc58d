// Work files of an interrupted run, as they are and with the checksum that belongs to them.

#include <zlib.h>

#include "fuzz/fuzz_input.h"
#include "work_files.h"

ACMP_FUZZ_TARGET(work_file) {
  using namespace acmp;
  constexpr size_t kChecksumAt = 16, kContentAt = 20;  // width: bytes 4 to 7, height: 8 to 11
  static const fuzz::Folder folder;
  std::string content(fuzz::Bytes(data, size).Rest());
  const auto read = [&] {
    const auto path = folder.Write("work_file", content);
    CheckWorkFile(path);
    fuzz::MayRefuse([&] { ReadEstimate(path, 3, 2); });
    fuzz::MayRefuse([&] { ReadFinalMaps(path); });
  };
  read();
  if (content.size() < kContentAt) return 0;
  const auto* bytes = reinterpret_cast<const Bytef*>(content.data());
  const uLong head = crc32_z(0, bytes, kChecksumAt);
  const auto checksum = static_cast<uint32_t>(
      content.size() == kContentAt ? head : crc32_z(head, bytes + kContentAt, content.size() - kContentAt));
  std::memcpy(content.data() + kChecksumAt, &checksum, sizeof(checksum));
  read();
  return 0;
}
