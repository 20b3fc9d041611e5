#!/usr/bin/env python3
"""Exports CLIPSeg (in three parts) and Mask2Former to ONNX, with a manifest that the robot checks at start.

    pip install -r requirements.txt
    ./export.py --out DIR                    # real weights, from the hub; writes DIR/fp32 and DIR/int8
    ./export.py --out DIR --random-weights   # real architecture, seeded random weights: for speed and tests
    ./export.py --out DIR --random-weights --tiny --parity   # small, with reference answers for the parity test

CLIPSeg is cut where the model itself joins its parts: the image is encoded once a frame (only as many layers as
the decoder reads), a phrase once ever, and the decoder draws the maps of all phrases at once. int8 is dynamic
quantisation of the weights. What the models mean is none of this script's business.
"""

import argparse
import hashlib
import json
import pathlib
import shutil

import numpy
import onnx
import onnxruntime.quantization
import torch
import transformers
from PIL import Image

CLIPSEG = "CIDAS/clipseg-rd64-refined"
MASK2FORMER = "facebook/mask2former-swin-tiny-coco-panoptic"
MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
CLIPSEG_SIDE = 352
PHRASES = ["chair", "the red sofa", "a table by the window"]


class ImageEncoder(torch.nn.Module):
    """Pixels to the activations that the decoder reads; later layers are not computed."""

    def __init__(self, model):
        super().__init__()
        self.vision = model.clip.vision_model
        self.extract = model.extract_layers

    def forward(self, pixel_values):
        hidden = self.vision.embeddings(pixel_values, interpolate_pos_encoding=True)
        hidden = self.vision.pre_layrnorm(hidden)
        found = []
        for idx, layer in enumerate(self.vision.encoder.layers[: max(self.extract) + 1]):
            hidden = layer(hidden, attention_mask=None)
            hidden = hidden[0] if isinstance(hidden, tuple) else hidden
            if idx in self.extract:
                found.append(hidden)
        return tuple(found)


class TextEncoder(torch.nn.Module):
    """Tokens of one phrase to its vector."""

    def __init__(self, model):
        super().__init__()
        self.clip = model.clip

    def forward(self, input_ids, attention_mask):
        return self.clip.get_text_features(input_ids=input_ids, attention_mask=attention_mask).pooler_output


class Decoder(torch.nn.Module):
    """Vectors of phrases and one image's activations to one map a phrase."""

    def __init__(self, model):
        super().__init__()
        self.decoder = model.decoder

    def forward(self, conditional, first, second, third):
        side = CLIPSEG_SIDE
        return self.decoder((first, second, third), conditional).logits.reshape(-1, side, side)


class Whole(torch.nn.Module):
    """CLIPSeg in one piece, an image for each phrase: what the three parts are measured against."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, pixel_values, input_ids, attention_mask):
        return self.model(pixel_values=pixel_values, input_ids=input_ids, attention_mask=attention_mask).logits


class Panoptic(torch.nn.Module):
    """Pixels to queries."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, pixel_values):
        answer = self.model(pixel_values=pixel_values)
        return answer.class_queries_logits, answer.masks_queries_logits


def random_tokenizer(folder):
    """A byte-pair tokenizer built like CLIP's from a few words: the hub has the real one."""
    from tokenizers import Regex, Tokenizer, decoders, models, normalizers, pre_tokenizers, processors, trainers

    tokenizer = Tokenizer(models.BPE(unk_token="<|endoftext|>", end_of_word_suffix="</w>"))
    tokenizer.normalizer = normalizers.Sequence(
        [normalizers.NFC(), normalizers.Replace(Regex(r"\s+"), " "), normalizers.Lowercase()]
    )
    words = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [pre_tokenizers.Split(Regex(words), "removed", invert=True), pre_tokenizers.ByteLevel(add_prefix_space=False)]
    )
    tokenizer.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=600,
        special_tokens=["<|startoftext|>", "<|endoftext|>"],
        initial_alphabet=sorted(pre_tokenizers.ByteLevel.alphabet()),
        end_of_word_suffix="</w>",
        show_progress=False,
    )
    tokenizer.train_from_iterator(PHRASES + ["the sofa and the desk are under the window of the room"], trainer)
    start, end = (tokenizer.token_to_id(token) for token in ("<|startoftext|>", "<|endoftext|>"))
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<|startoftext|> $A <|endoftext|>",
        special_tokens=[("<|startoftext|>", start), ("<|endoftext|>", end)],
    )
    tokenizer.save(str(folder / "tokenizer.json"))
    return start, end


def random_models(folder, seed, tiny):
    start, end = random_tokenizer(folder)
    torch.manual_seed(seed)
    ids = {"bos_token_id": start, "eos_token_id": end, "pad_token_id": end}
    small = {"hidden_size": 32, "intermediate_size": 64, "num_attention_heads": 4, "num_hidden_layers": 4}
    text = {**ids, **(small if tiny else {})}
    vision = {"patch_size": 16, "image_size": 224, **(small if tiny else {})}
    config = transformers.CLIPSegConfig(
        text_config=text,
        vision_config=vision,
        use_complex_transposed_convolution=True,
        **({"extract_layers": [0, 1, 3], "projection_dim": 24, "reduce_dim": 16} if tiny else {}),
    )
    clipseg = transformers.CLIPSegForImageSegmentation(config)
    depths, embed = ([1, 1, 1, 1], 24) if tiny else ([2, 2, 6, 2], 96)
    backbone = transformers.SwinConfig(
        image_size=224, patch_size=4, embed_dim=embed, depths=depths, num_heads=[3, 6, 12, 24], window_size=7,
        drop_path_rate=0.0, out_features=["stage1", "stage2", "stage3", "stage4"],
    )
    sizes = {"num_queries": 30, "feature_size": 32, "mask_feature_size": 32, "hidden_dim": 32,
             "encoder_feedforward_dim": 64, "dim_feedforward": 64, "encoder_layers": 2, "decoder_layers": 3,
             "num_attention_heads": 4}
    config = transformers.Mask2FormerConfig(
        backbone_config=backbone, num_labels=8 if tiny else 133, **(sizes if tiny else {})
    )
    mask2former = eager(transformers.Mask2FormerForUniversalSegmentation, config)
    spread(mask2former)
    return clipseg, mask2former, end


def spread(mask2former):
    """Random queries are all alike: one segment would hide every slip in what is done with the others."""
    with torch.no_grad():
        for name, weight in mask2former.named_parameters():
            if "queries_" in name:
                weight.copy_(torch.randn_like(weight))
            elif name == "class_predictor.weight":
                weight.copy_(torch.randn_like(weight) * 0.3)
            elif "mask_embedder" in name and name.endswith("weight"):
                weight.copy_(torch.randn_like(weight) * 0.4)


def eager(kind, config, weights=None):
    """The default attention cannot be exported."""
    config._attn_implementation = "eager"
    config.backbone_config._attn_implementation = "eager"
    return kind(config) if weights is None else kind.from_pretrained(weights, config=config)


def real_models(folder):
    clipseg = transformers.CLIPSegForImageSegmentation.from_pretrained(CLIPSEG)
    tokenizer = transformers.AutoTokenizer.from_pretrained(CLIPSEG)
    tokenizer.backend_tokenizer.save(str(folder / "tokenizer.json"))
    config = transformers.AutoConfig.from_pretrained(MASK2FORMER)
    mask2former = eager(transformers.Mask2FormerForUniversalSegmentation, config, MASK2FORMER)
    return clipseg, mask2former, tokenizer.pad_token_id


def export(module, arguments, file, inputs, outputs, dynamic=None):
    module.eval()
    with torch.no_grad():
        torch.onnx.export(
            module, arguments, str(file), dynamo=True, opset_version=18, input_names=inputs, output_names=outputs,
            dynamic_shapes=dynamic, external_data=False, verbose=False,
        )


def quantise(file, into):
    model = onnx.load(str(file))
    # Shapes that the exporter left in contradict those of quantised nodes.
    del model.graph.value_info[:]
    plain = into.with_suffix(".plain.onnx")
    onnx.save(model, str(plain))
    onnxruntime.quantization.quantize_dynamic(
        str(plain), str(into), weight_type=onnxruntime.quantization.QuantType.QUInt8,
        op_types_to_quantize=["MatMul", "Gemm"],
    )
    plain.unlink()


def ports(values):
    def shape(value):
        return [dim.dim_value if dim.HasField("dim_value") else -1 for dim in value.type.tensor_type.shape.dim]

    return [{"name": value.name, "shape": shape(value)} for value in values]


def entry(folder, role, name):
    file = folder / name
    found = {"role": role, "file": name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    if name.endswith(".onnx"):
        graph = onnx.load(str(file), load_external_data=False).graph
        found |= {"inputs": ports(graph.input), "outputs": ports(graph.output)}
    return found


def write_manifest(folder, precision, weights, pad_id, mask2former, size, limits, n_tokens):
    names = mask2former.config.id2label
    labels = [names[idx] for idx in range(len(names))]
    files = {"clipseg_image": "clipseg-image.onnx", "clipseg_text": "clipseg-text.onnx",
             "clipseg_decoder": "clipseg-decoder.onnx", "mask2former": "mask2former.onnx",
             "tokenizer": "tokenizer.json"}
    manifest = {
        "format": 1,
        "weights": weights,
        "precision": precision,
        "clipseg": {"side_px": CLIPSEG_SIDE, "mean": MEAN, "std": STD, "n_tokens": n_tokens, "pad_id": pad_id},
        "mask2former": {"width_px": size[0], "height_px": size[1], "mean": MEAN, "std": STD, "labels": labels, **limits},
        "files": [entry(folder, role, name) for role, name in files.items()],
    }
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n")


def export_all(folder, clipseg, mask2former, size, n_tokens, whole):
    image = torch.zeros(1, 3, CLIPSEG_SIDE, CLIPSEG_SIDE)
    ids, mask = torch.ones(1, n_tokens, dtype=torch.int64), torch.ones(1, n_tokens, dtype=torch.int64)
    encoder = ImageEncoder(clipseg)
    names = [f"activation{idx}" for idx in range(len(clipseg.extract_layers))]
    export(encoder, (image,), folder / "clipseg-image.onnx", ["pixel_values"], names)
    export(TextEncoder(clipseg), (ids, mask), folder / "clipseg-text.onnx", ["input_ids", "attention_mask"], ["vector"])
    with torch.no_grad():
        activations = encoder(image)
    phrases = torch.export.Dim("phrases", min=1, max=256)
    vectors = torch.randn(3, clipseg.config.projection_dim)
    export(Decoder(clipseg), (vectors, *activations), folder / "clipseg-decoder.onnx", ["conditional", *names],
           ["logits"], {"conditional": {0: phrases}, "first": None, "second": None, "third": None})
    export(Panoptic(mask2former), (torch.zeros(1, 3, size[1], size[0]),), folder / "mask2former.onnx",
           ["pixel_values"], ["class_queries_logits", "masks_queries_logits"])
    if whole:
        export(Whole(clipseg), (image.repeat(3, 1, 1, 1), ids.repeat(3, 1), mask.repeat(3, 1)),
               folder / "clipseg-whole.onnx", ["pixel_values", "input_ids", "attention_mask"], ["logits"])


def reference(folder, clipseg, mask2former, pad_id, n_tokens, size):
    """What the reference implementation says of one image, post-processing included; and thresholds that
    random weights reach."""
    from tokenizers import Tokenizer

    rows, cols = numpy.mgrid[0:300, 0:400]
    picture = numpy.stack([cols * 255 // 400, rows * 255 // 300, (cols // 40 + rows // 30) % 2 * 200], -1).astype("uint8")
    image = Image.fromarray(picture)
    image.save(folder / "parity.png")
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    tokenizer.enable_padding(length=n_tokens, pad_id=pad_id)
    tokens = tokenizer.encode_batch(PHRASES)
    ids = torch.tensor([token.ids for token in tokens])
    mask = torch.tensor([token.attention_mask for token in tokens])
    kinds = transformers.models
    processor = kinds.vit.image_processing_pil_vit.ViTImageProcessorPil(
        size={"height": CLIPSEG_SIDE, "width": CLIPSEG_SIDE}, image_mean=MEAN, image_std=STD)
    pixels = processor([image] * len(PHRASES), return_tensors="pt").pixel_values
    with torch.no_grad():
        logits = clipseg(pixel_values=pixels, input_ids=ids, attention_mask=mask).logits
    heat = torch.sigmoid(logits).numpy().astype("<f4")
    heat.tofile(folder / "parity-heat.f32")
    processor = kinds.mask2former.image_processing_pil_mask2former.Mask2FormerImageProcessorPil(
        size={"height": size[1], "width": size[0]}, image_mean=MEAN, image_std=STD)
    with torch.no_grad():
        answer = mask2former(pixel_values=processor([image], return_tensors="pt").pixel_values)
    scores, classes = answer.class_queries_logits.softmax(-1)[0].max(-1)
    kept = scores[classes < answer.class_queries_logits.shape[-1] - 1]
    score_min = float(kept.median()) if len(kept) else 0.0
    limits = {"score_min": score_min, "mask_min": score_min * 0.5, "overlap_min": 0.02}
    found = processor.post_process_panoptic_segmentation(
        answer, threshold=limits["score_min"], mask_threshold=limits["mask_min"],
        overlap_mask_area_threshold=limits["overlap_min"], label_ids_to_fuse=set(), target_sizes=[(300, 400)])[0]
    found["segmentation"].numpy().astype("<i4").tofile(folder / "parity-segments.i32")
    classes = [segment["label_id"] for segment in found["segments_info"]]
    (folder / "parity.json").write_text(json.dumps({"phrases": PHRASES, "classes": classes}) + "\n")
    return limits


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for fp32/ and int8/")
    parser.add_argument("--random-weights", action="store_true", help="seeded random weights, without the hub")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tiny", action="store_true", help="a small architecture; only with random weights")
    parser.add_argument("--parity", action="store_true", help="also write what the reference says of one image")
    parser.add_argument("--whole", action="store_true", help="also export CLIPSeg in one piece")
    parser.add_argument("--width", type=int, default=640, help="of Mask2Former's image, a multiple of 32")
    parser.add_argument("--height", type=int, default=480)
    arguments = parser.parse_args()
    if arguments.tiny and not arguments.random_weights:
        parser.error("--tiny needs --random-weights")
    fp32, int8 = arguments.out / "fp32", arguments.out / "int8"
    fp32.mkdir(parents=True, exist_ok=True)
    int8.mkdir(parents=True, exist_ok=True)
    size = (arguments.width, arguments.height)
    if arguments.random_weights:
        clipseg, mask2former, pad_id = random_models(fp32, arguments.seed, arguments.tiny)
        weights = f"random, seed {arguments.seed}"
    else:
        clipseg, mask2former, pad_id = real_models(fp32)
        weights = f"{CLIPSEG}, {MASK2FORMER}"
    clipseg.eval(), mask2former.eval()
    n_tokens = clipseg.config.text_config.max_position_embeddings
    limits = {"score_min": 0.5, "mask_min": 0.5, "overlap_min": 0.8}
    if arguments.parity:
        found = reference(fp32, clipseg, mask2former, pad_id, n_tokens, size)
        limits = found if arguments.random_weights else limits
    export_all(fp32, clipseg, mask2former, size, n_tokens, arguments.whole)
    write_manifest(fp32, "fp32", weights, pad_id, mask2former, size, limits, n_tokens)
    for file in fp32.glob("*.onnx"):
        quantise(file, int8 / file.name)
    shutil.copy(fp32 / "tokenizer.json", int8 / "tokenizer.json")
    write_manifest(int8, "int8", weights, pad_id, mask2former, size, limits, n_tokens)
    print(f"{fp32} and {int8}: {weights}")


if __name__ == "__main__":
    main()
