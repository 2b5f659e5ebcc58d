#include "work_blocks.h"

#include <zlib.h>

#include <cstring>
#include <fstream>
#include <vector>

#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

struct BlockHeader {
  uint32_t magic = 0x314b4c42;  // "BLK1"
  uint32_t checksum = 0;        ///< of the content
  uint64_t bytes = 0;           ///< of the content
};

uint32_t ChecksumOf(const char* data, size_t bytes, uint32_t before = 0) {
  return static_cast<uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(data), bytes));
}

}  // namespace

void WriteBlock(const std::filesystem::path& path, const std::string& content) {
  BlockHeader header;
  header.checksum = ChecksumOf(content.data(), content.size());
  header.bytes = content.size();
  MakeFolder(path.parent_path());
  AtomicFile file(path);
  file.Write(&header, sizeof(header));
  file.Write(content);
  file.Commit();
}

std::optional<std::string> ReadBlock(const std::filesystem::path& path) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  BlockHeader header;
  std::ifstream file(path, std::ios::binary);
  if (error || !file.read(reinterpret_cast<char*>(&header), sizeof(header)) || header.magic != BlockHeader().magic ||
      header.bytes + sizeof(header) != bytes) {
    return std::nullopt;
  }
  std::string content(header.bytes, '\0');
  if (!file.read(content.data(), static_cast<std::streamsize>(content.size())) ||
      ChecksumOf(content.data(), content.size()) != header.checksum) {
    return std::nullopt;
  }
  return content;
}

std::optional<uint32_t> ChecksumOfFile(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::vector<char> block(size_t{1} << 18);
  uint32_t checksum = 0;
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0) {
    checksum = ChecksumOf(block.data(), static_cast<size_t>(file.gcount()), checksum);
  }
  return checksum;
}

}  // namespace acmp
