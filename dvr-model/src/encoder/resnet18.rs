//! ResNet-18 (He et al. 2016) as torchvision defines it, with the linear layer of DVR's reference code behind it.

use burn::module::{Module, RunningState};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::pool::{MaxPool2d, MaxPool2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::pooling::global_mean;

/// Length of the features before the last linear layer.
const FEATURES: usize = 512;

/// Mean and standard deviation of ImageNet's sRGB channels, which the pretrained weights expect.
const IMAGENET: [[f32; 3]; 2] = [[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]];

/// The paper's image encoder: ImageNet normalisation, the features of a ResNet-18, and a linear layer to the code.
///
/// Parameter names are those of the reference code's checkpoints, below `encoder.`.
#[derive(Module, Debug)]
pub struct Resnet18 {
    /// Everything up to the global average.
    pub features: Resnet18Features,
    /// Features to code, `[512, code_dim]`.
    pub fc: Linear,
}

impl Resnet18 {
    /// Random parameters, as torchvision and PyTorch draw them.
    pub fn new(code_dim: usize, device: &Device) -> Self {
        Self { features: Resnet18Features::new(device), fc: LinearConfig::new(FEATURES, code_dim).init(device) }
    }

    /// Codes `[b, code_dim]` of images `[b, 3, height, width]`, sRGB in `[0, 1]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        self.fc.forward(self.features.forward(normalised(images)))
    }
}

/// Images as ImageNet classifiers take them: mean 0 and deviation 1 per channel over ImageNet, in the images' precision.
pub(super) fn normalised(images: Tensor<4>) -> Tensor<4> {
    let place = (&images.device(), images.dtype());
    let [mean, deviation] = IMAGENET.map(|values| Tensor::<1>::from_data(values, place).reshape([1, 3, 1, 1]));
    (images - mean) / deviation
}

/// torchvision's `resnet18` without its classifier: images `[b, 3, height, width]` to features `[b, 512]`.
///
/// Where gradients are tracked, batch normalisation takes the batch's statistics and updates the running ones;
/// elsewhere it takes the running ones. (burn's running variance is the batch's own, PyTorch's is larger by `n / (n -
/// 1)`, where `n` is images times pixels.)
#[derive(Module, Debug)]
pub struct Resnet18Features {
    /// 7x7, stride 2, 64 channels.
    pub conv1: Conv2d,
    /// After `conv1`.
    pub bn1: BatchNorm,
    /// 3x3, stride 2.
    pub maxpool: MaxPool2d,
    /// Two blocks of 64 channels.
    pub layer1: Vec<BasicBlock>,
    /// Two blocks of 128 channels, stride 2.
    pub layer2: Vec<BasicBlock>,
    /// Two blocks of 256 channels, stride 2.
    pub layer3: Vec<BasicBlock>,
    /// Two blocks of 512 channels, stride 2.
    pub layer4: Vec<BasicBlock>,
    /// Batches seen in training, `[1]`: PyTorch's `num_batches_tracked`, which it keeps in every normalisation. It
    /// changes no result; it is here so that nothing is lost between the programs.
    pub batches_tracked: RunningState<Tensor<1>>,
}

impl Resnet18Features {
    /// Random parameters: He's normal distribution by fan-out for convolutions, as torchvision draws them.
    pub fn new(device: &Device) -> Self {
        let layer = |input, output, stride| {
            vec![BasicBlock::new(input, output, stride, device), BasicBlock::new(output, output, 1, device)]
        };
        Self {
            conv1: convolution([3, 64], 7, 2, device),
            bn1: BatchNormConfig::new(64).init(device),
            maxpool: MaxPool2dConfig::new([3, 3])
                .with_strides([2, 2])
                .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
                .init(),
            layer1: layer(64, 64, 1),
            layer2: layer(64, 128, 2),
            layer3: layer(128, 256, 2),
            layer4: layer(256, FEATURES, 2),
            batches_tracked: RunningState::new(Tensor::zeros([1], device)),
        }
    }

    /// Features `[b, 512]` of normalised images `[b, 3, height, width]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let training = images.device().is_autodiff() && self.bn1.training.is_enabled();
        let mut net = self.maxpool.forward(relu(self.bn1.forward(self.conv1.forward(images))));
        for block in self.blocks() {
            net = block.forward(net);
        }
        if training {
            self.settle_statistics();
        }
        global_mean(net)
    }

    /// All blocks in order.
    fn blocks(&self) -> impl Iterator<Item = &BasicBlock> {
        [&self.layer1, &self.layer2, &self.layer3, &self.layer4].into_iter().flatten()
    }

    /// Counts the batch and writes its statistics down.
    ///
    /// burn keeps a layer's last update aside until the next one, where a checkpoint taken in between would miss it.
    fn settle_statistics(&self) {
        self.batches_tracked.update((self.batches_tracked.value_sync() + 1.0).detach());
        self.batches_tracked.value_sync();
        for norm in std::iter::once(&self.bn1).chain(self.blocks().flat_map(BasicBlock::norms)) {
            norm.running_mean.value_sync();
            norm.running_var.value_sync();
        }
    }
}

/// `relu(shortcut(x) + bn2(conv2(relu(bn1(conv1(x))))))`, both convolutions 3x3.
#[derive(Module, Debug)]
pub struct BasicBlock {
    /// Has the block's stride.
    pub conv1: Conv2d,
    /// After `conv1`.
    pub bn1: BatchNorm,
    /// Stride 1.
    pub conv2: Conv2d,
    /// After `conv2`.
    pub bn2: BatchNorm,
    /// The shortcut where the shape changes: a 1x1 convolution and its normalisation.
    pub downsample: Option<(Conv2d, BatchNorm)>,
}

impl BasicBlock {
    fn new(input: usize, output: usize, stride: usize, device: &Device) -> Self {
        let norm = || BatchNormConfig::new(output).init(device);
        Self {
            conv1: convolution([input, output], 3, stride, device),
            bn1: norm(),
            conv2: convolution([output, output], 3, 1, device),
            bn2: norm(),
            downsample: (stride != 1).then(|| (convolution([input, output], 1, stride, device), norm())),
        }
    }

    fn norms(&self) -> impl Iterator<Item = &BatchNorm> {
        [&self.bn1, &self.bn2].into_iter().chain(self.downsample.as_ref().map(|(_, norm)| norm))
    }

    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let net = relu(self.bn1.forward(self.conv1.forward(input.clone())));
        let net = self.bn2.forward(self.conv2.forward(net));
        let shortcut = match &self.downsample {
            Some((convolution, norm)) => norm.forward(convolution.forward(input)),
            None => input,
        };
        relu(net + shortcut)
    }
}

/// A square convolution without bias that keeps the size but for its stride.
fn convolution(channels: [usize; 2], kernel: usize, stride: usize, device: &Device) -> Conv2d {
    let pad = kernel / 2;
    Conv2dConfig::new(channels, [kernel, kernel])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
        .with_bias(false)
        .with_initializer(Initializer::KaimingNormal { gain: f64::sqrt(2.0), fan_out_only: true })
        .init(device)
}
